"""Orthotropic materials: exact linear displacements, energies, and isotropic constants."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import DISTRIBUTIONS, EXACT, discrete, grown, roots

from fx_contact import (
    ContactPair,
    Dirichlet,
    Displacement,
    InitialStrain,
    Material,
    Orthotropic,
    RigidSphere,
    RigidSurface,
    Scene,
    SceneError,
    SymmetryPlane,
    ThermalStrain,
    Traction,
    adapt,
    block,
    root_mesh_from_shapes,
    solve,
)
from fx_contact.estimate.estimator import Estimator
from fx_contact.estimate.shear_free import ShearFree
from fx_contact.parallel.timing import Stages

DEGREES = pytest.mark.parametrize("degree", (1, 2))
PARALLEL = pytest.mark.ranks(1, 2, 3)
#: Unidirectional carbon fibres in epoxy, along x [GPa].
CARBON = Orthotropic((140.0, 10.0, 9.0), (0.3, 0.28, 0.4), (5.0, 4.5, 3.5))
#: Spruce: fibres, radius and tangent of the year rings [GPa].
SPRUCE = Orthotropic((10.7, 0.71, 0.43), (0.38, 0.51, 0.51), (0.5, 0.62, 0.023))
ISOTROPIC = Orthotropic((10.0,) * 3, (0.3,) * 3, (10 / 2.6,) * 3, ((1, 2, 0), (-2, 1, 3)))


def turned(angle):
    """The material with its fibres at an angle to x, about z."""
    c, s = np.cos(angle), np.sin(angle)
    return replace(CARBON, axes=((c, s, 0.0), (-s, c, 0.0)))


def slab(material, **changes):
    """A block of a material between planes."""
    mesh = root_mesh_from_shapes({"slab": block((0, 0, 0), (2, 1, 1), (4, 2, 2), 1)})
    held = tuple(SymmetryPlane(f"slab {side}") for side in ("left", "front", "bottom"))
    return replace(Scene("slab", mesh, {"slab": material}, held), **changes)


@PARALLEL
@DEGREES
@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_tension_across_the_fibres(distribution, degree):
    """Fibres at an angle t to a tension: 1/E_x = c^4/E_1 + (1/G_12 - 2 nu_12/E_1) s^2 c^2 + s^4/E_2, and a shear.

    Source: Jones, equations (2.96).  On hanging meshes stress, energy and forces are exact, without estimated error.
    """
    angle, sigma = np.radians(30), 0.01
    c, s = np.cos(angle), np.sin(angle)
    (e1, e2, _), (nu12, nu13, nu23), (g12, *_) = CARBON.young, CARBON.poisson, CARBON.shear
    strain = np.zeros((3, 3))
    strain[0, 0] = sigma * (c**4 / e1 + (1 / g12 - 2 * nu12 / e1) * s**2 * c**2 + s**4 / e2)
    strain[1, 1] = sigma * ((1 / e1 + 1 / e2 - 1 / g12) * s**2 * c**2 - nu12 / e1 * (s**4 + c**4))
    strain[2, 2] = -sigma * (nu13 / e1 * c**2 + nu23 / e2 * s**2)
    shear = (2 / e1 + 2 * nu12 / e1 - 1 / g12) * s * c**3 - (2 / e2 + 2 * nu12 / e1 - 1 / g12) * s**3 * c
    strain[0, 1] = strain[1, 0] = sigma * shear / 2
    scene = slab(turned(angle))
    forest = DISTRIBUTIONS[distribution](grown(roots(scene), 3, share=0.2))
    elasticity = discrete(scene, forest, degree=degree)
    assert elasticity.prolongation.hanging_global > 10
    position = elasticity.prolongation.injected(elasticity.prolongation.space.positions())
    u, nowhere = position @ strain, ShearFree(np.zeros(position.shape, dtype=bool))
    field = elasticity.field(u)
    error = Estimator(elasticity, nowhere, Stages()).error(field)
    energy = np.sqrt(sigma * strain[0, 0] * 2)
    assert error.estimate.error_global < 1e-10 * energy
    assert error.estimate.energy_norm == pytest.approx(energy, rel=1e-10)
    assert elasticity.energy_norm(u) == pytest.approx(energy, rel=1e-10)
    off = elasticity.at_leaves(error.stress) - np.array([sigma, 0, 0, 0, 0, 0])
    everywhere(np.abs(off).max(initial=0) < 1e-10 * sigma, "stress")
    inside = (np.abs(position - [1, 0.5, 0.5]) < [1 - 1e-9, 0.5 - 1e-9, 0.5 - 1e-9]).all(axis=1)
    everywhere(np.abs(elasticity.internal_forces(field)[inside]).max(initial=0) < 1e-10 * sigma, "forces")


@PARALLEL
@DEGREES
def test_isotropic_constants(degree):
    """With isotropic constants along any axes the solution below a sphere is that of a Material."""
    assert ISOTROPIC.stiffness == pytest.approx(Material(10.0, 0.3).stiffness, rel=1e-12, abs=1e-12)
    pair = ContactPair("slab top", RigidSphere((0.0, 0.0, 3.0), 2.0), moved=(0, 0, -0.01))
    steps = [
        list(adapt(slab(material, contact=pair), 0.3, degree=degree, solver=EXACT, max_steps=3))[-1]
        for material in (Material(10.0, 0.3), ISOTROPIC)
    ]
    one, other = steps
    assert one.record.cells == other.record.cells and one.record.force > 0
    assert other.record.force == pytest.approx(one.record.force, rel=1e-9)
    assert other.record.estimate == pytest.approx(one.record.estimate, rel=1e-8)


@PARALLEL
def test_restrained_expansion_along_the_fibres():
    """Held along the fibres, free across: sigma = -E_1 alpha dT."""
    scene = slab(CARBON, strains=ThermalStrain("slab", 1e-6, 100.0))
    scene = replace(scene, dirichlet=(*scene.dirichlet, Dirichlet("slab right", x=0.0)))
    step = solve(scene, 0.1, solver=EXACT)
    known = np.array([-140.0 * 1e-4, 0, 0, 0, 0, 0])
    everywhere(np.abs(step.nodal_stress - known).max(initial=0) < 1e-7 * 140e-4, "stress")
    assert step.record.estimate < 1e-7 and "orthotropic" in repr(scene)


def test_axes_are_the_directions_of_the_constants():
    """Stiffness turned by a right angle is that with exchanged constants; its mean is an isotropic material."""
    swapped = Orthotropic((10.0, 140.0, 9.0), (0.3 / 14, 0.4, 0.28), (5.0, 3.5, 4.5))
    assert turned(np.pi / 2).stiffness == pytest.approx(swapped.stiffness, rel=1e-10, abs=1e-10)
    assert turned(0.4).isotropic.young == pytest.approx(CARBON.isotropic.young, rel=1e-12)
    assert 9 < CARBON.isotropic.young < 140


def test_bad_constants():
    """Constants and axes that cannot be meant are refused."""
    for changes, message in (
        ({"young": (140.0, -1.0, 9.0)}, "young"),
        ({"axes": ((1, 0, 0),)}, "two directions"),
        ({"axes": ((0, 0, 0), (1, 1, 0))}, "axis"),
        ({"young": (1000.0, 1, 1), "poisson": (0.499, 0.499, 0.997), "shear": (0.33, 0.33, 0.25)}, "incompressible"),
        ({"young": (1.0,) * 3, "poisson": (0.49,) * 3, "shear": (1 / 2.98,) * 3}, "incompressible"),
        ({"young": (1.0,) * 3, "poisson": (0.401,) * 3, "shear": (1 / 2.802,) * 3}, "is 4.72 times"),
        ({"young": (1.0,) * 3, "poisson": (0.3,) * 3, "shear": (1 / 2.6, 0.01, 0.01)}, "incompressible"),
    ):
        with pytest.raises(SceneError, match=message):
            replace(CARBON, **changes)


def test_wood_is_not_nearly_incompressible():
    """One small shear modulus, of rolling shear, is none of the volume: Sitka spruce, spruce, balsa."""
    for young, poisson, shear in (
        ((1.0, 0.078, 0.043), (0.372, 0.467, 0.435), (0.064, 0.061, 0.003)),
        (SPRUCE.young, SPRUCE.poisson, SPRUCE.shear),
        ((1.0, 0.046, 0.015), (0.229, 0.488, 0.665), (0.054, 0.037, 0.005)),
    ):
        assert not Orthotropic(young, poisson, shear).projected
    assert Orthotropic((1.0,) * 3, (0.399,) * 3, (1 / 2.798,) * 3).young == (1.0, 1.0, 1.0)


def test_volume_of_wood_does_not_lock():
    """Bent across its year rings, its error is the same without any coupling of volume and shape."""
    c = np.sqrt(0.5)
    deflections = []
    for poisson, degree in product((SPRUCE.poisson, (0.0, 0.0, 0.0)), (1, 2)):
        material = replace(SPRUCE, poisson=poisson, axes=((1, 0, 0), (0, c, c)))
        mesh = root_mesh_from_shapes({"beam": block((0, 0, 0), (0.25, 4, 1), (1, 16, 4), 1)})
        held = SymmetryPlane("beam left"), SymmetryPlane("beam right"), Dirichlet("beam front", 0.0, 0.0, 0.0)
        scene = Scene("beam", mesh, {"beam": material}, held, tractions=Traction("beam back", (0, 0, 1e-6)))
        goal = Displacement((0.0, 4.0, 1.0), (0, 0, 1), 0.9)
        deflections.append(solve(scene, 0.9, degree=degree, max_steps=1, goals=goal).record.goals[0].value)
    wood, without = deflections[0] / deflections[1], deflections[2] / deflections[3]
    assert 0.94 * without < wood < without  # of nu = 0.49 without projection it would be 0.58 of it


@pytest.mark.ranks(1, 2)
def test_ball_on_spruce():
    """Semi-axes and largest pressure of a half-space below a paraboloid, computed independently, within 0.4 %."""
    size, radius, force, known = 6.8, 10.0, 0.0232781, (0.531407, 0.847116)
    mesh = root_mesh_from_shapes({"wood": block((0, 0, -size), (size, size, 0), (2, 2, 2), 1)})
    ball = RigidSurface(
        lambda x: (x[0] ** 2 + x[1] ** 2) / (2 * radius) - x[2],
        lambda x: np.stack([0 * x[0], 0 * x[0], 0 * x[0] - 1]),
    )
    held = Dirichlet("wood bottom", 0.0, 0.0, 0.0), SymmetryPlane("wood left"), SymmetryPlane("wood front")
    pair = ContactPair("wood top", ball, force=(0.0, 0.0, -force))
    step = solve(Scene("wood", mesh, {"wood": SPRUCE}, held, pair, symmetry=4), 0.04)
    assert step.record.reached and not step.record.doubts and step.record.force == pytest.approx(force, rel=1e-6)
    contact = step.contact
    sums = WORLD.allreduce(np.append((contact.points[:, :2] ** 2).T @ contact.force, contact.force.sum()))
    assert np.sqrt(5 * sums[:2] / sums[2]) == pytest.approx(known, rel=4e-3)
    assert step.record.max_pressure == pytest.approx(0.0246898, rel=4e-3)


def test_mirrors_need_symmetric_materials():
    """Fibres and strains askew to a symmetry plane are refused where it makes copies."""
    scene = slab(turned(0.0), symmetry=8, strains=InitialStrain("slab", 1e-3 * np.diag([1.0, 2, 3])))
    assert scene.mirrors.parts == 8
    rollers = [Dirichlet(f"slab {side}", **{axis: 0.0}) for side, axis in zip(("left", "front", "bottom"), "xyz")]
    for planes in (scene.dirichlet, rollers):
        with pytest.raises(SceneError, match="material of 'slab' changes in the mirror"):
            replace(scene, dirichlet=planes, materials={"slab": turned(0.3)})
    askew = 1e-3 * np.array([[1.0, 0.1, 0], [0.1, 1, 0], [0, 0, 1]])
    with pytest.raises(SceneError, match="initial strain of 'slab' changes in the mirror"):
        replace(scene, strains=InitialStrain("slab", askew))
