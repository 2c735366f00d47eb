"""Thermal and initial strains against exact solutions."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import everywhere
from model_problems import DISTRIBUTIONS, EXACT, discrete, grown, roots

from fx_contact import (
    ContactPair,
    Dirichlet,
    Displacement,
    InitialStrain,
    Material,
    Reaction,
    Scene,
    SceneError,
    SymmetryPlane,
    ThermalStrain,
    adapt,
    ball,
    block,
    join,
    ring,
    root_mesh_from_shapes,
    solve,
)
from fx_contact.estimate.estimator import Estimator
from fx_contact.estimate.shear_free import ShearFree
from fx_contact.parallel.timing import Stages
from fx_contact.results.analytic import ShrinkFit

STEEL, RUBBER = Material(2e5, 0.3), Material(2.0, 0.4995)
ALPHA, HOT = 1e-5, 100.0
DEGREES = pytest.mark.parametrize("degree", (1, 2))
PARALLEL = pytest.mark.ranks(1, 2, 3)


def slab(degree=1):
    """A block that is free to expand."""
    mesh = root_mesh_from_shapes({"slab": block((0, 0, 0), (2, 1, 1), (2, 1, 1), degree)})
    held = tuple(SymmetryPlane(f"slab {side}") for side in ("left", "front", "bottom"))
    return Scene("slab", mesh, {"slab": STEEL}, held, strains=ThermalStrain("slab", ALPHA, HOT))


def tube(**changes):
    """A quarter of a tube between frictionless planes, heated."""
    mesh = root_mesh_from_shapes({"tube": ring(1, 2, 0.5, (2, 3, 1), quarters=1)})
    held = tuple(SymmetryPlane(f"tube {side}") for side in ("x = 0", "y = 0", "bottom"))
    scene = Scene("tube", mesh, {"tube": STEEL}, held, strains=ThermalStrain("tube", ALPHA, HOT))
    return replace(scene, **changes)


def displaced(step):
    """Positions and displacements (n, 3) of this rank's nodes."""
    prolongation = step.elasticity.prolongation
    return prolongation.space.positions(), prolongation.prolong(step.solution.displacement)


@PARALLEL
@DEGREES
@pytest.mark.parametrize("material", (STEEL, RUBBER))
@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_free_expansion_on_hanging_meshes(distribution, material, degree):
    """A ball that expands freely has the displacement alpha dT x and no stress, forces or estimated error."""
    mesh = root_mesh_from_shapes({"ball": ball(1, 1, degree, octants=1)})
    held = tuple(SymmetryPlane(f"ball {axis} = 0") for axis in "xyz")
    scene = Scene("ball", mesh, {"ball": material}, held, strains=ThermalStrain("ball", ALPHA, HOT))
    forest = DISTRIBUTIONS[distribution](grown(roots(scene), 3, share=0.2))
    elasticity = discrete(scene, forest, order=degree, degree=degree)
    assert elasticity.prolongation.hanging_global > 20
    u = elasticity.prolongation.injected(ALPHA * HOT * elasticity.prolongation.space.positions())
    stress = material.young * ALPHA * HOT
    field = elasticity.field(u, loaded=True)
    everywhere(np.abs(elasticity.internal_forces(field)).max(initial=0) < 1e-11 * stress, "forces")
    everywhere(np.abs(elasticity.stress_free_forces()).max(initial=0) > 1e-4 * stress, "no load")
    error = Estimator(elasticity, ShearFree(np.zeros(u.shape, dtype=bool)), Stages()).error(field).estimate
    assert error.energy_norm < 1e-10 * elasticity.energy_norm(u)
    volume = np.pi / 6 * (1 if degree == 2 else 0.7)  # of the faceted ball, about
    shear = material.young / (2 * (1 + material.poisson))
    assert elasticity.restraint_norm() == pytest.approx(ALPHA * HOT * np.sqrt(6 * shear * volume), rel=0.2)


@PARALLEL
@pytest.mark.parametrize("material", (STEEL, RUBBER))
def test_free_expansion_of_a_curved_part(material):
    """A run ends at once, without stress, where the geometry has the degree of the displacements."""
    step = solve(tube(materials={"tube": material}), 0.02, geometry_order=2, solver=EXACT)
    position, u = displaced(step)
    everywhere(np.abs(u - ALPHA * HOT * position).max(initial=0) < 1e-10 * ALPHA * HOT, "displacement")
    everywhere(np.abs(step.nodal_stress).max(initial=0) < 1e-10 * material.young * ALPHA * HOT, "stress")
    assert step.record.reached and step.record.estimate < 1e-9


@DEGREES
def test_linear_temperature(degree):
    """Linear temperature dT = a . x: no stress, u = alpha ((a . x) x - |x|^2 a / 2), of degree 2."""
    slope = np.array([30.0, -20.0, 50.0])

    def exact(x):
        """The displacement (3, n)."""
        return ALPHA * ((slope @ x) * x - (x**2).sum(axis=0) * slope[:, None] / 2)

    scene = slab()
    ends = tuple(
        Dirichlet(side, *(lambda x, axis=axis: exact(x)[axis] for axis in range(3))) for side in scene.mesh.surfaces
    )
    heat = ThermalStrain("slab", ALPHA, lambda x: slope @ x)
    step = solve(replace(scene, dirichlet=ends, strains=heat), 0.5, degree=degree, solver=EXACT)
    position, u = displaced(step)
    stress = np.abs(step.nodal_stress).max(initial=0) / (STEEL.young * ALPHA * 50)
    if degree == 2:
        assert np.abs(u - exact(position.T).T).max() < 1e-12 * ALPHA * 50 and stress < 1e-9
    else:
        assert stress > 1e-3, "linear displacements cannot bend"


@PARALLEL
@DEGREES
@pytest.mark.parametrize("poisson", (0.3, 0.4995))
def test_restrained_bar(degree, poisson):
    """A bar between walls: sigma = -E alpha dT along it, nothing across; the walls push with it."""
    scene = slab()
    held = (*scene.dirichlet, Dirichlet("slab right", x=0.0))
    young = 200.0
    scene = replace(scene, dirichlet=held, materials={"slab": Material(young, poisson)})
    step = solve(scene, 0.1, degree=degree, solver=EXACT, goals=[Reaction("slab right", 0.1)])
    known = np.zeros(6)
    known[0] = -young * ALPHA * HOT
    everywhere(np.abs(step.nodal_stress - known).max(initial=0) < 1e-7 * young * ALPHA * HOT, "stress")
    (reaction,) = [one for one in step.record.resultants if one.name == "slab right"]
    assert reaction.force == pytest.approx((known[0], 0, 0), abs=1e-9 * abs(known[0]))
    assert step.record.goals[0].value == pytest.approx(known[0], rel=1e-9)
    assert step.record.reached and step.record.estimate < 1e-7


@PARALLEL
def test_misfit_shear():
    """An initial strain of any symmetric tensor in a free block: u = eps_0 x, where rotations are held."""
    tensor = 1e-3 * np.array([[1.0, 0.4, -0.2], [0.4, -2.0, 0.3], [-0.2, 0.3, 0.5]])
    scene = slab()
    corners = {"at": (0.0, 0.0, 0.0), "x": (2.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0)}
    at = {name: int(np.abs(scene.mesh.points - point).sum(axis=1).argmin()) for name, point in corners.items()}
    mesh = replace(scene.mesh, vertices={name: np.array([node]) for name, node in at.items()})
    exact = {name: tensor @ point for name, point in corners.items()}
    held = (
        Dirichlet("at", 0.0, 0.0, 0.0),
        Dirichlet("x", y=exact["x"][1], z=exact["x"][2]),
        Dirichlet("y", z=exact["y"][2]),
    )
    for value in (tensor, lambda x: np.broadcast_to(tensor[:, :, None], (3, 3, x.shape[1]))):
        step = solve(
            replace(scene, mesh=mesh, dirichlet=held, strains=InitialStrain("slab", value)), 0.1, solver=EXACT
        )
        position, u = displaced(step)
        everywhere(np.abs(u - position @ tensor).max(initial=0) < 1e-10 * 1e-3, "displacement")


@PARALLEL
@DEGREES
def test_bonded_layers_heated(degree):
    """Two parts of one material, one of them heated, on all sides held: the stress jumps, without estimated error."""
    lower, upper = (
        block((0, 0, z), (1, 1, z + 1), (2, 2, 2), 1).as_part(name) for z, name in enumerate(("lower", "upper"))
    )
    mesh = root_mesh_from_shapes({"stack": join(lower, upper)})
    poisson, hot = 0.3, ALPHA * HOT
    # In plane strain_xx = strain_yy = 0; free along z: strain_zz of the heated layer.
    rise = hot * (1 + poisson) / (1 - poisson)
    moved = {"x": 0.0, "y": 0.0, "z": lambda x: rise * np.maximum(x[2] - 1, 0)}
    held = tuple(Dirichlet(side, **moved) for side in mesh.surfaces)
    scene = Scene(
        "stack", mesh, dict.fromkeys(mesh.regions, STEEL), held, strains=ThermalStrain("stack upper", ALPHA, HOT)
    )
    assert set(scene.layers) == {0, 1}
    step = solve(scene, 0.1, degree=degree, solver=EXACT)
    assert step.record.estimate < 1e-7
    known = np.zeros((len(step.forest.cell), 1, 6))
    hot_cells = scene.mesh.region[step.forest.cell] == scene.mesh.regions.index("stack upper")
    known[hot_cells, :, :2] = -STEEL.young * hot / (1 - poisson)
    everywhere(np.abs(step.nodal_stress - known).max(initial=0) < 1e-6 * STEEL.young * hot, "stress")


def heated_tube(young, poisson, radius, inner=1.0, outer=2.0, alpha=ALPHA):
    """Radial and hoop stress in plane strain for dT = HOT r^2 (Timoshenko, Goodier, section 151), and u at `outer`."""

    def moment(r):
        """Integral of T r."""
        return HOT * (r**4 - inner**4) / 4

    scale, whole = alpha * young / (1 - poisson) / radius**2, moment(outer) / (outer**2 - inner**2)
    radial = scale * ((radius**2 - inner**2) * whole - moment(radius))
    hoop = scale * ((radius**2 + inner**2) * whole + moment(radius) - HOT * radius**4)
    grown_by = 2 * (1 + poisson) * alpha * whole * outer
    return radial, hoop, grown_by


@PARALLEL
def test_heated_tube():
    """A tube in plane strain with dT = HOT r^2: error within the tolerance, effectivity, displacement as a goal."""
    heat = ThermalStrain("tube", ALPHA, lambda x: HOT * (x[0] ** 2 + x[1] ** 2))
    scene = tube(strains=heat)
    scene = replace(scene, dirichlet=(*scene.dirichlet, SymmetryPlane("tube top")))
    goal = Displacement((2.0, 0.0, 0.0), (1, 0, 0), 1e-3)
    step = solve(scene, 0.02, goals=[goal])
    position, _ = displaced(step)
    space = step.elasticity.prolongation.space
    radius = np.linalg.norm(position[:, :2], axis=1)
    radial, hoop, grown_by = heated_tube(STEEL.young, STEEL.poisson, radius)
    across = (position[:, 0] / radius) ** 2
    known = (radial * across + hoop * (1 - across))[space.cells]
    off = np.abs(step.nodal_stress[..., 0] - known).max(initial=0)
    everywhere(off < 0.05 * STEEL.young * ALPHA * HOT, "stress")
    (found,) = step.record.goals
    assert step.record.reached and abs(found.value / grown_by - 1) < found.tolerance


@PARALLEL
def test_press_fit_by_cooling():
    """Rings whose outer one is cooled have the pressures of rings with the interference alpha dT b by `clearance`.

    Both are those of Lame.  On 3 facets a quarter mean normals differ from radii by 5e-5 at the symmetry planes.
    """
    radii = (1.0, 2.0, 3.0)
    bodies = {
        name: ring(low, high, 0.5, (2, 3, 1), 2, quarters=1)
        for name, low, high in (("inner", *radii[:2]), ("outer", *radii[1:]))
    }
    mesh = root_mesh_from_shapes(bodies)
    held = tuple(SymmetryPlane(f"{body} {side}") for body in bodies for side in ("x = 0", "y = 0", "bottom"))
    cold, interference = ThermalStrain("outer", ALPHA, -HOT), ALPHA * HOT * radii[1]
    pair = ContactPair("inner outside", "outer inside")
    scene = Scene("fit", mesh, {"inner": STEEL, "outer": STEEL}, held, pair)
    pressed = replace(scene, contact=replace(pair, clearance=-interference))
    steps = [next(adapt(one, 0.1, geometry_order=2, solver=EXACT)) for one in (pressed, replace(scene, strains=cold))]
    one, other = (step.contact.pressure for step in steps)
    everywhere(np.allclose(one, other, rtol=2e-4), "another pressure")
    lame = ShrinkFit(radii, interference, STEEL, STEEL).pressure
    assert steps[0].record.force == pytest.approx(steps[1].record.force, rel=1e-5)
    assert steps[1].record.force == pytest.approx(lame * np.pi / 2 * radii[1] * 0.5, rel=0.01)


def test_bad_strains():
    """Strains that cannot be meant are refused when they or their scene are made."""
    for make, message in (
        (lambda: ThermalStrain("slab", "a", 1.0), "expansion of 'slab'"),
        (lambda: ThermalStrain("slab", 1e-5, np.nan), "change of temperature"),
        (lambda: replace(slab(), strains=ThermalStrain("slab", 1e-5, lambda x: 1 / (x[0] < -1))), "must be finite"),
        (lambda: replace(slab(), strains=InitialStrain("slab", lambda x: x)), r"\(3, 3, "),
    ):
        with pytest.raises(SceneError, match=message), np.errstate(divide="ignore"):
            make()
