"""Displacements, pressures and body forces as numbers and as functions of position, against exact solutions."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import DISTRIBUTIONS, STEEL, discrete, grown, roots, two_boxes, vertex_positions

from fx_contact import BodyForce, Dirichlet, Pressure, Scene, SymmetryPlane, Traction, adapt
from fx_contact.adaptive.beginning import Beginning
from fx_contact.fem.external_forces import load
from fx_contact.fem.leaf_mesh import leaf_positions
from fx_contact.geometry.hexahedron import corner_nodes
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.parallel.errors import SceneError
from fx_contact.scene.fingerprint import scene_parts
from fx_contact.scenes import punch, stack
from studies.stability.twins import scaled, turned

SIDES = [f"upper {axis} {end}" for axis in "xyz" for end in ("low", "high")]


def box(order=1, **options):
    """The upper box of `two_boxes` alone: the body "upper" with its six sides, 2 x 2 x 2 unit cells."""
    both = two_boxes(order=order, **options)
    ours = np.flatnonzero(both.body == 1)
    number = np.full(len(both.body), -1)
    number[ours] = np.arange(len(ours))
    nodes, cells = np.unique(both.cells[ours], return_inverse=True)
    sides = {n: np.stack([number[both.surfaces[n][:, 0]], both.surfaces[n][:, 1]], axis=1) for n in SIDES}
    cells, zeros = cells.reshape(len(ours), -1), np.zeros(len(ours), dtype=int)
    first = cells[0, corner_nodes(order)]
    return RootMesh(both.points[nodes], cells, ("upper",), zeros, sides, {"first cell": first})


def scene_of(mesh, held=(SymmetryPlane("upper z low"),), **loads):
    """A body cut by symmetry, held sideways where it is flat."""
    held = (*held, SymmetryPlane("upper x low"), SymmetryPlane("upper y low"))
    return Scene("one body", mesh, {"upper": STEEL}, held, **loads)


def total(scene, degree=1):
    """Sum of the generalised forces over a refined forest with hanging nodes: (3,)."""
    forest = DISTRIBUTIONS["strewn"](grown(roots(scene), 2))
    elasticity = discrete(scene, forest, scene.mesh.order, degree)
    assert elasticity.prolongation.hanging_global > 0
    return WORLD.allreduce(load(scene, forest, elasticity).sum(axis=0))


@pytest.mark.parametrize("order, degree", [(3, 1), (4, 1), (3, 2)])
def test_pressure_on_a_sphere(order, degree):
    """The cap of a punch is pushed up by p times its projected area, whatever its shape; likewise along x and y."""
    scene = punch(radius=1.0, side=1.0, order=order, coarse=2)
    force = total(replace(scene, tractions=(Pressure("base", 3.0),)), degree)
    assert abs(force[2] / (3.0 * 0.25) - 1) < 1e-12
    # The side x = 0 of the cap lies under z = 1 - sqrt(1 - y^2), the side x = 1/2 higher: their difference is pushed.
    y, w = np.polynomial.legendre.leggauss(40)
    y, w = (y + 1) / 4, w / 4
    area = w @ (np.sqrt(1 - y**2) - np.sqrt(0.75 - y**2))
    assert abs(force[0] / (3.0 * area) + 1) < {3: 1e-3, 4: 3e-5}[order]
    assert abs(force[0] - force[1]) < 1e-9


def test_closed_surface():
    """A uniform pressure all around a bent body has no resultant; one that falls with the height lifts its volume."""
    mesh = box(order=2, bend=0.1)
    held = Dirichlet("first cell", 0.0, 0.0, 0.0)
    around = Scene("body", mesh, {"upper": STEEL}, (held,), tractions=tuple(Pressure(side, 2.0) for side in SIDES))
    assert np.abs(total(around)).max() < 1e-12
    falling = replace(around, tractions=tuple(Pressure(side, lambda x: 5 - x[2]) for side in SIDES))
    weight = replace(around, tractions=(), body_forces=(BodyForce("upper", (0.0, 0.0, -1.0)),))
    lift, load = total(falling), total(weight)
    assert lift[2] > 7 and np.abs(lift + load).max() < 1e-4 * lift[2]


@pytest.mark.parametrize("as_function", [False, True])
def test_immersed(as_function):
    """Under pressure from all sides a body shrinks alike, on distorted cells with hanging vertices too."""
    value = (lambda x: np.full(x.shape[1], 0.01)) if as_function else 0.01
    scene = scene_of(box(), tractions=tuple(Pressure(f"upper {axis} high", value) for axis in "xyz"))
    (step,) = adapt(scene, 0.1, max_steps=1)
    assert step.record.estimate < 1e-6 and step.record.contact_iterations == 1
    strain = -0.01 * (1 - 2 * STEEL.poisson) / STEEL.young
    exact = strain * leaf_positions(step.forest, slice(None), step.record.degree)
    everywhere(np.abs(step.nodal_displacement - exact).max() < 1e-6 * abs(strain), "not uniform")


def test_weight_of_a_column():
    """u = g (h z - z^2/2)/E of a hanging column without lateral strain, exact at the vertices of Q1 cells."""
    weight = BodyForce("upper", lambda x: np.outer([0.0, 0.0, 0.01], np.ones(len(x[0]))))
    scene = scene_of(box(distortion=0.0), body_forces=(weight,))
    scene = replace(scene, materials={"upper": replace(STEEL, poisson=0.0)})
    (step,) = adapt(scene, 0.01, degree=1, max_steps=1)
    z = vertex_positions(step.forest)[step.forest.vertices.cells.ravel()][:, 2]
    exact = 0.01 / STEEL.young * (2 * z - z**2 / 2)
    everywhere(np.abs(step.nodal_displacement.reshape(-1, 3)[:, 2] - exact).max() < 1e-7 * 0.01, "another curve")


@pytest.mark.parametrize("degree, distortion", [(1, 0.25), (2, 0.0)])
def test_displacement_all_around(degree, distortion):
    """Linear displacements are exact on any cells, quadratic ones, with their body force, on affine ones."""
    random = np.random.default_rng(3)
    gradient, curvature = 1e-3 * random.uniform(-1, 1, (3, 3)), 1e-3 * random.uniform(-1, 1, (3, 3, 3))
    curvature += curvature.transpose(0, 2, 1)
    curvature *= degree - 1  # u_i = g_i x + x A_i x

    def u(x):
        return np.einsum("ij,j...->i...", gradient, x) + np.einsum("ijk,j...,k...->i...", curvature, x, x)

    lame = STEEL.young * STEEL.poisson / ((1 + STEEL.poisson) * (1 - 2 * STEEL.poisson))
    shear = STEEL.young / (2 * (1 + STEEL.poisson))
    traces = np.einsum("iij->j", curvature), np.einsum("ijj->i", curvature)
    weight = -2 * ((lame + shear) * traces[0] + shear * traces[1])
    held = tuple(Dirichlet(side, *(lambda x, i=i: u(x)[i] for i in range(3))) for side in SIDES)
    loads = (BodyForce("upper", lambda x: np.tile(weight[:, None], len(x[0]))),)
    scene = Scene("bent", box(distortion=distortion), {"upper": STEEL}, held, body_forces=loads)
    beginning = Beginning.at_rest(grown(roots(scene), 2))
    (step,) = adapt(scene, 0.1, degree=degree, max_steps=1, beginning=beginning)
    exact = np.moveaxis(u(np.moveaxis(leaf_positions(step.forest, slice(None), degree), 2, 0)), 0, 2)
    assert step.record.hanging_nodes > 0 and (degree == 2 or step.record.estimate < 1e-6)
    everywhere(np.abs(step.nodal_displacement - exact).max() < 1e-7 * np.abs(exact).max(), "another displacement")


def test_symmetry_plane_is_a_condition():
    """A plane across an axis holds the component along it, another one that along its outward normal."""
    assert scene_of(box()).conditions[0] == Dirichlet("upper z low", z=0.0)
    mesh, tilt = box(), np.array([[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]])
    scene = scene_of(replace(mesh, points=mesh.points @ tilt.T))
    assert scene.oblique_planes == (scene.conditions[0], scene.conditions[2])
    assert np.allclose([plane.normal for plane in scene.oblique_planes], -tilt.T[[2, 1]], atol=1e-15)
    assert scene.conditions[1] == Dirichlet("upper x low", x=0.0)
    assert "'upper z low' (across 0, 0.6, -0.8)" in repr(scene) and scene_parts(scene) != scene_parts(scene_of(mesh))
    with pytest.raises(SceneError, match="plane facets only"):
        scene_of(box(order=2, bend=0.1))
    with pytest.raises(SceneError, match="unknown surface 'upper z lwo'.*did you mean 'upper z low'"):
        scene_of(mesh, held=(SymmetryPlane("upper z lwo"),))


TOP, LOW = "upper z high", "upper z low"


def pressed_by(value):
    """A pressure on top of the box."""
    return lambda: scene_of(box(), tractions=(Pressure(TOP, value),))


@pytest.mark.parametrize("turned", [False, True], ids=["as it is", "turned round"])
def test_conditions_that_agree_but_for_rounding(turned):
    """Rounding is measured by the largest displacement of the scene, whichever condition comes first."""
    side, rounding = "upper z low", np.finfo(float).eps * 0.01
    for x, fails in ((rounding, False), (1e-4 * 0.01, True)):
        held = [SymmetryPlane(side), Dirichlet(side, z=x), Dirichlet("upper z high", z=0.01)]
        held = tuple(held[:: -1 if turned else 1])
        with pytest.raises(SceneError, match="another condition says") if fails else nullcontext():
            scene_of(box(), held)


def test_checkpoints_know_functions():
    """Two functions are the same if they give the same; a bump between the root mesh's nodes is seen."""

    def asks(**parts):
        return scene_parts(scene_of(box(), **parts))

    for make in (
        lambda f: {"held": (Dirichlet("upper z low", z=f),)},
        lambda f: {"tractions": (Pressure("upper z high", f),)},
        lambda f: {"body_forces": (BodyForce("upper", lambda x: np.stack([f(x)] * 3)),)},
    ):
        assert asks(**make(lambda x: 1e-3 * x[1])) == asks(**make(lambda x: x[1] / 1000))
        bump = asks(**make(lambda x: 1e-3 * x[1] + 1e-5 * np.sin(np.pi * x[0])))
        assert asks(**make(lambda x: 1e-3 * x[1])) != bump


def test_twins():
    """Functions turn and scale with the scene."""
    scene = stack()
    held = (
        Dirichlet("bottom", 0.0, 0.0, 0.0),
        Dirichlet("top", x=0.0, y=lambda x: 0.01 * x[1], z=lambda x: -0.01 - 0.01 * x[0]),
        Dirichlet("under block 1", x=0.0, y=0.0),
    )
    scene = replace(
        scene,
        dirichlet=held,
        tractions=(Pressure("x = 0", lambda x: 0.01 * x[2]), Traction("y = 0", lambda x: 0.01 * x[[1, 2, 0]])),
        body_forces=(BodyForce("block 1", lambda x: 0.01 * x),),
        symmetry=1,
    )
    any_size = {"max_steps": 1, "allow": ("large strain", "large rotation")}
    first = next(iter(adapt(scene, 0.5, **any_size))).record
    for twin, factor in ((scaled(scene, 1e-3, 1e6), 1.0), (turned(scene, np.roll(np.eye(3), 1, axis=0)), 1.0)):
        record = next(iter(adapt(twin, 0.5, **any_size))).record
        assert first.force > 0 and abs(record.force / first.force / factor - 1) < 1e-6
        assert abs(record.estimate / first.estimate - 1) < 1e-6
