"""Bodies of several materials against exact solutions, with stresses that jump at their interfaces."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
import ufl
from conftest import WORLD, everywhere
from dolfinx import fem
from model_problems import DISTRIBUTIONS, discrete, grown, roots

from fx_contact import BodyForce, Dirichlet, Material, Pressure, Scene, SymmetryPlane, adapt, results, solve
from fx_contact.estimate.estimator import Estimator
from fx_contact.estimate.shear_free import ShearFree
from fx_contact.estimate.stress_projection import projected_stress
from fx_contact.geometry.shapes import join, root_mesh_from_shapes
from fx_contact.geometry.solids import ball, block, ring
from fx_contact.geometry.swept_shapes import sweep_side
from fx_contact.parallel.timing import Stages
from fx_contact.plot import draw_stress, plotter_for

SOFT, HARD, RUBBER = Material(1.0, 0.3), Material(10.0, 0.2), Material(0.1, 0.499)
DEGREES = pytest.mark.parametrize("degree", (1, 2))
#: Radii of the parts of tubes and spheres.
INNER, MIDDLE, OUTER = 1.0, 1.5, 2.5
LOAD = 1e-6


def lame(material):
    """The two Lame coefficients."""
    young, poisson = material.young, material.poisson
    return young * poisson / ((1 + poisson) * (1 - 2 * poisson)), young / (2 * (1 + poisson))


def layers(materials, strain, counts=(1, 2, 1)):
    """Bonded layers of height 1, extended along x and y by a strain in plane stress: linear in each layer."""
    names = [f"layer {z}" for z in range(len(materials))]
    blocks = (block((0, 0, z), (2, 2, z + 1), counts, 1).as_part(name) for z, name in enumerate(names))
    mesh = root_mesh_from_shapes({"stack": join(*blocks)})
    first, second = np.array([lame(material) for material in materials]).T
    slopes = -2 * strain * first / (first + 2 * second)
    heights = np.concatenate([[0.0], np.cumsum(slopes)])

    def raised(x):
        """u_z."""
        return np.interp(x[2], np.arange(len(heights)), heights)

    moved = {"x": lambda x: strain * x[0], "y": lambda x: strain * x[1], "z": raised}
    held = tuple(Dirichlet(side, **moved) for side in mesh.surfaces)
    in_plane = 2 * strain * (first + second) + first * slopes
    return Scene("layers", mesh, {f"stack {n}": m for n, m in zip(names, materials)}, held), moved, in_plane


@pytest.mark.ranks(1, 2, 3)
@DEGREES
@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_stress_that_jumps_between_layers(distribution, degree):
    """Recovered and shown stress of a linear displacement in each layer are exact, also at hanging nodes: no error."""
    scene, moved, in_plane = layers((SOFT, HARD, SOFT, RUBBER), strain := 1e-3)
    forest = DISTRIBUTIONS[distribution](grown(roots(scene), 3, share=0.2))
    elasticity = discrete(scene, forest, degree=degree)
    assert elasticity.prolongation.hanging_global > 20
    nodal = elasticity.prolongation.space.positions()
    u = elasticity.prolongation.injected(np.stack([component(nodal.T) for component in moved.values()], axis=1))
    field, nowhere = elasticity.field(u), ShearFree(np.zeros(u.shape, dtype=bool))
    estimator = Estimator(elasticity, nowhere, Stages())
    error = estimator.error(field)
    assert error.estimate.error_global < 1e-10 * error.estimate.energy_norm
    everywhere(np.abs(estimator.products(error, error)).max(initial=0) < 1e-18, "products")
    sigma = in_plane[scene.mesh.region[forest.cell]] / strain
    known = np.zeros((len(sigma), 1, 6))
    known[:, 0, :2] = sigma[:, None]
    for stress in (error.stress, projected_stress(elasticity, field, nowhere, Stages())):
        off = elasticity.at_leaves(stress) / strain - known
        everywhere(np.abs(off).max(initial=0) < 1e-6, "another stress")  # 1e-8 by the solver of the projection
    elastic = elasticity.on(elasticity.prolongation)
    assert elastic.energy_norm(u) == pytest.approx(elasticity.energy_norm(u), rel=1e-14)


@DEGREES
def test_parts_of_one_material(degree):
    """Parts with equal materials are as one."""
    scene = tube((SOFT, SOFT))[0]
    one = replace(scene, mesh=replace(scene.mesh, parts={}), materials={"tube": SOFT})
    first, second = (list(adapt(s, tolerance=0.05, degree=degree, max_steps=3))[-1] for s in (scene, one))
    assert first.record.cells == second.record.cells
    assert first.record.estimate == pytest.approx(second.record.estimate, rel=1e-9)
    size = np.abs(first.nodal_stress).max(initial=1e-300)
    everywhere(np.abs(first.nodal_stress - second.nodal_stress).max(initial=0) < 1e-7 * size, "another stress")


@DEGREES
def test_files_and_grids(degree, folder):
    """Stresses of ParaView and pyvista jump as the nodal ones do; displacements do not."""
    step = solve(layers((SOFT, HARD, SOFT), 1e-3)[0], 0.1, degree=degree)
    known = layers((SOFT, HARD, SOFT), 1e-3)[2][step.forest.mesh.region[step.forest.cell[step.leaf_mesh.leaf]]]
    grid = step.to_pyvista()
    of_cell = grid.point_data["stress"][grid.cells.reshape(len(known), -1)[:, 1:]]
    everywhere(np.abs(of_cell[..., 0] - known[:, None]).max(initial=0) < 1e-7, "another stress in pyvista")
    moved = grid.point_data["displacement"][:, 0] - 1e-3 * grid.points[:, 0]
    everywhere(np.abs(moved).max(initial=0) < 1e-9, "another displacement")
    results.write_fields(step, folder)
    assert list(folder.glob("bodies*vtu"))


@pytest.mark.ranks(1, 2)
def test_cut(folder):
    """The section of a picture shows the stress of each layer, both at an interface."""
    step = solve(layers((SOFT, HARD), 1e-3)[0], 0.1)
    with plotter_for(folder / "cut.png", 400, 300) if WORLD.rank == 0 else nullcontext() as plotter:
        draw_stress(step, plotter=plotter)
        if plotter:
            section = next(m for m in plotter.meshes if "value" in m.point_data)
            at = np.abs(section.points[:, 2] - 1) < 1e-9
            known = sorted(np.abs(layers((SOFT, HARD), 1e-3)[2]))
            assert np.unique(section["value"].round(9)) == pytest.approx(known, rel=1e-5)
            assert np.unique(section["value"][at].round(9)) == pytest.approx(known, rel=1e-5)


# Manufactured: plane strains grad(psi) on both sides of z = 1, which is free of stress: u_z = c s psi sin(z - 1) with
# c = lambda / (lambda + 2 mu), s = P^2 + Q^2.
P, Q = 1.0, 1.5
S = P**2 + Q**2


def manufactured(materials):
    """Two cubes, bonded, with body forces of their own; c of each."""
    parts = (block((0, 0, z), (1, 1, z + 1), (2, 2, 2), 1).as_part(n) for z, n in enumerate(("lower", "upper")))
    mesh = root_mesh_from_shapes({"bar": join(*parts)})
    ratios = [first / (first + 2 * second) for first, second in map(lame, materials)]

    def moved(component):
        """A component of the exact displacement, the same for all sides."""
        return lambda x: LOAD * solution(np, x, np.where(x[2] < 1, *ratios))[component]

    def force(material, c):
        """-div sigma."""
        first, second = lame(material)

        def density(x):
            *slopes, _ = solution(np, x, c)
            psi, height = np.cos(P * x[0]) * np.cos(Q * x[1]), x[2] - 1
            in_plane = S * ((first + second) * (1 - c * np.cos(height)) + second)
            across = S * psi * np.sin(height) * c * (first + second + second * (S + 1))
            return LOAD * np.array([in_plane * slopes[0], in_plane * slopes[1], across])

        return density

    names = ("bar lower", "bar upper")
    forces = tuple(BodyForce(name, force(*pair)) for name, pair in zip(names, zip(materials, ratios)))
    held = tuple(Dirichlet(side, moved(0), moved(1), moved(2)) for side in mesh.surfaces)
    return Scene("manufactured", mesh, dict(zip(names, materials)), held, body_forces=forces), ratios


def solution(library, x, c):
    """The manufactured displacement over `LOAD`."""
    sin, cos = library.sin, library.cos
    psi = cos(P * x[0]) * cos(Q * x[1])
    return (-P * sin(P * x[0]) * cos(Q * x[1]), -Q * cos(P * x[0]) * sin(Q * x[1]), c * S * psi * sin(x[2] - 1))


def of_parts(step, values):
    """Values (nregions, k) as a Function, constant in each part."""
    values = np.reshape(values, (len(values), -1))
    function = fem.Function(fem.functionspace(step.mesh, ("DG", 0, values.shape[1:])))
    region = step.scene.mesh.region[step.forest.cell[step.leaf_mesh.leaf]]
    function.x.array.reshape(-1, values.shape[1])[function.function_space.dofmap.list[:, 0]] = values[region]
    return function


@pytest.mark.ranks(1, 2, 3)
@DEGREES
@pytest.mark.parametrize("materials", [(SOFT, Material(1e3, 0.3)), (Material(1.0, 0.0), SOFT)])
def test_effectivity(materials, degree):
    """0.8 to 1.25 on all meshes, in a solution with jumps of stress."""
    scene, ratios = manufactured(materials)
    found = []
    for step in adapt(scene, tolerance=0.06 if degree == 1 else 0.003, degree=degree):
        x = ufl.SpatialCoordinate(step.mesh)
        exact = LOAD * ufl.as_vector(solution(ufl, x, of_parts(step, ratios)[0]))
        off = results.field_error(step.elasticity, step.displacement, exact)
        found.append(step.record.estimate / off.energy)
    assert step.record.reached and step.record.hanging_nodes > 20
    assert 0.8 < min(found) and max(found) < 1.25


def tube(materials, order=4):
    """A quarter of a tube of two layers with a pressure inside, in plane strain; (A, B) of u = A r + B / r in each."""
    parts = (
        ring(*ends, 0.5, (2, 3, 1), order, quarters=1).as_part(name)
        for name, ends in (("lining", (INNER, MIDDLE)), ("jacket", (MIDDLE, OUTER)))
    )
    mesh = root_mesh_from_shapes({"tube": join(*parts)})
    planes = tuple(SymmetryPlane(f"tube {side}") for side in ("x = 0", "y = 0", "bottom", "top"))
    known = dict(zip(("tube lining", "tube jacket"), materials))
    scene = Scene("tube", mesh, known, planes, tractions=(Pressure("tube inside", LOAD),))
    (first, second), (other, shear) = map(lame, materials)
    # s_rr = 2 (lambda + mu) A - 2 mu B / r^2
    equations = [
        [2 * (first + second), -2 * second / INNER**2, 0, 0],
        [2 * (first + second), -2 * second / MIDDLE**2, -2 * (other + shear), 2 * shear / MIDDLE**2],
        [MIDDLE, 1 / MIDDLE, -MIDDLE, -1 / MIDDLE],
        [0, 0, 2 * (other + shear), -2 * shear / OUTER**2],
    ]
    return scene, np.linalg.solve(equations, [-LOAD, 0, 0, 0]).reshape(2, 2)


def spheres(materials, order=4):
    """An eighth of a ball in a shell with a pressure outside; (A, B) of u = A r + B / r^2 in each."""
    core = ball(INNER, 2, order, octants=1)
    shell = sweep_side(core, "outside", lambda x, t: x * (1 + t * (MIDDLE / INNER - 1)), layers=2)
    mesh = root_mesh_from_shapes({"bead": join(core.as_part("core"), shell.as_part("shell"))})
    planes = tuple(SymmetryPlane(f"bead {side}") for side in ("x = 0", "y = 0", "z = 0"))
    known = dict(zip(("bead core", "bead shell"), materials))
    scene = Scene("bead", mesh, known, planes, tractions=(Pressure("bead end", LOAD),))
    (first, second), (other, shear) = map(lame, materials)
    # s_rr = (3 lambda + 2 mu) A - 4 mu B / r^3
    equations = [
        [3 * first + 2 * second, -3 * other - 2 * shear, 4 * shear / INNER**3],
        [INNER, -INNER, -1 / INNER**2],
        [0, 3 * other + 2 * shear, -4 * shear / MIDDLE**3],
    ]
    a, b, c = np.linalg.solve(equations, [0, 0, -LOAD])
    return scene, np.array([[a, 0], [b, c]])


@pytest.mark.ranks(1, 2, 3)
@DEGREES
@pytest.mark.parametrize("make", [tube, spheres])
@pytest.mark.parametrize("materials", [(SOFT, HARD), (RUBBER, SOFT)])
def test_composite_tube_and_sphere(make, materials, degree):
    """Displacements within 0.1 %, and the estimated error is not below 0.8 of the true one."""
    scene, coefficients = make(materials)
    for step in adapt(scene, tolerance=0.015 if degree == 1 else 0.005, degree=degree, geometry_order=4):
        pass
    x, power = ufl.SpatialCoordinate(step.mesh), 2 if make is tube else 3
    r = ufl.sqrt(sum(x[axis] ** 2 for axis in range(power)))
    of_part = of_parts(step, coefficients)
    radial = of_part[0] + of_part[1] / r**power
    exact = radial * ufl.as_vector([x[0], x[1], x[2] if make is spheres else 0])
    off = results.field_error(step.elasticity, step.displacement, exact)
    assert off.l2 < 1e-3
    if RUBBER not in materials:  # the true error takes the pointwise volume strain, the estimate the projected one
        assert step.record.estimate > 0.8 * off.energy
