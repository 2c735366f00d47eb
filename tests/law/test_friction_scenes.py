"""Friction in scenes with known resultants: inclines, wedges, corners, ties and thermal strain."""

import re

import numpy as np
import pytest
from conftest import everywhere
from friction_checks import check_law, contact_force, largest, resultant, tractions
from model_problems import STEEL

from fx_contact import (
    BodyForce,
    ContactPair,
    Dirichlet,
    Material,
    RigidMotion,
    RigidPlane,
    Scene,
    SolveError,
    Solver,
    SymmetryPlane,
    ThermalStrain,
    Tie,
    Traction,
    adapt,
    block,
    increments,
    join,
    root_mesh_from_shapes,
)
from fx_contact.contact.constraint_rows import Role

pytestmark = pytest.mark.ranks(1, 2, 3)

MU = 0.3
EXACT = Solver(tolerance=1e-12)
#: Relative error of forces at the default tolerance of the linear solver, 1e-8 of the energy norm.
SOLVED = 1e-6
GROUND = RigidPlane((0, 0, 0), (0, 0, 1))

# ------------------------------------------------------------------------------------------------ inclines and wedges


def incline(slope):
    """A block below its own weight on a rigid plane, the slope of which turns the weight."""
    weight = np.array([slope, 0.0, -1.0]) * 1e-3 / np.hypot(slope, 1.0)
    mesh = root_mesh_from_shapes({"block": block((0, 0, 0), (1, 1, 0.25), (2, 2, 1), 1)})
    pair = ContactPair("block bottom", GROUND, friction=MU)
    return Scene("incline", mesh, {"block": Material(1.0, 0.3)}, (), pair, body_forces=BodyForce("block", weight))


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("part", [0.5, 0.999])
def test_incline_below_the_angle_of_friction(degree, part):
    """The contact force is the weight; the block comes to rest after slips of the order of its deformation."""
    step = next(adapt(incline(part * MU), 0.9, degree=degree))
    weight = resultant(step, "body force").force
    assert contact_force(step) == pytest.approx(weight, rel=SOLVED, abs=SOLVED * 1e-3)
    slipping, sticking = check_law(step)
    assert part > 0.9 and slipping > 0 or sticking > 0
    assert largest(np.abs(step.solution.slip)) < 1e-2


@pytest.mark.parametrize("degree", [1, 2])
def test_incline_beyond_the_angle_of_friction(degree):
    """The message has mu W cos, and W sin with the shear that balances itself."""
    scene = incline(1.01 * MU)
    down, _, normal = 0.25 * np.array(scene.body_forces[0].value)
    with pytest.raises(SolveError, match=f"friction carries about {-MU * normal:.4g} of ") as error:
        next(adapt(scene, 0.9, degree=degree))
    needed = float(re.search("of (.+) that would hold all nodes in place", str(error.value))[1])
    assert down < needed < 1.2 * down


ANGLE = np.radians(20)


def wedge(force, mu):
    """A slice of a wedge of half-angle `ANGLE`, pressed down between two rigid planes."""
    width = np.tan(ANGLE)
    shape = block((-1, 0, 1), (1, 0.25, 2), (4, 1, 2), 1).placed(lambda x: (width * x[0] * x[2], x[1], x[2]))
    mesh = root_mesh_from_shapes({"wedge": shape})
    sides = ("left", np.cos(ANGLE)), ("right", -np.cos(ANGLE))
    pairs = [ContactPair(f"wedge {s}", RigidPlane((0, 0, 0), (x, 0, np.sin(ANGLE))), friction=mu) for s, x in sides]
    held = SymmetryPlane("wedge front"), SymmetryPlane("wedge back")
    load = Traction("wedge top", (0.0, 0.0, -force / width))
    return Scene("wedge", mesh, {"wedge": Material(1.0, 0.3)}, held, pairs, tractions=load)


def test_wedge():
    """N = F / (2 (sin +- mu cos)) on each face, pressed in and backing out; between these the wedge sticks."""
    mu, found = 0.2, []
    for point in increments(lambda force: wedge(force, mu), (1e-3, 6e-4, 1e-4), 0.9, degree=1):
        slipping, sticking = check_law(point.step)
        for number, side in enumerate((1, -1)):
            out = np.array([-side * np.cos(ANGLE), 0.0, -np.sin(ANGLE)])
            along = np.array([side * np.sin(ANGLE), 0.0, -np.cos(ANGLE)])
            force = contact_force(point.step, number)
            found.append((force @ out, force @ along / (force @ out), slipping, sticking))
    for (normal, ratio, slipping, sticking), load, sign in zip(
        found, np.repeat([1e-3, 6e-4, 1e-4], 2), 2 * [1] + 2 * [0] + 2 * [-1]
    ):
        if sign:
            assert sticking == 0 < slipping
            assert normal == pytest.approx(load / 2 / (np.sin(ANGLE) + sign * mu * np.cos(ANGLE)), rel=SOLVED)
            assert ratio == pytest.approx(sign * mu, rel=SOLVED)
        else:
            assert sticking > 0 and abs(ratio) < mu


# ------------------------------------------------------------------------------------------- directions that turn


def turning(stage, upper):
    """A stiff cube on a soft one, pressed down, then moved along x, along y, and twisted."""
    x, y, twist = np.clip([stage, stage - 1, stage - 2], 0, 1) * [6e-3, 6e-3, 8e-3]
    lower = (2, 2, 2) if upper == (2, 2, 2) else (3, 3, 2)
    bodies = {"base": block((0, 0, -1), (1, 1, 0), lower, 1), "cube": block((0, 0, 0), (1, 1, 1), upper, 1)}
    motion = RigidMotion("cube top", (x, y, -1e-2), (0.0, 0.0, twist), (0.5, 0.5, 1.0))
    materials = {"base": Material(1.0, 0.3), "cube": Material(10.0, 0.3)}
    held, pair = (Dirichlet("base bottom", 0.0, 0.0, 0.0), motion), ContactPair(
        "base top", "cube bottom", friction=MU
    )
    return Scene("turning", root_mesh_from_shapes(bodies), materials, held, pair)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("upper", [(2, 2, 2), (4, 4, 2)], ids=["pairs", "mortar 4:3"])
def test_a_direction_that_turns(upper, degree):
    """The law holds at each node; the shear of one direction is kept by nodes that stick in the next."""
    forces, moments = [], []
    for point in increments(lambda stage: turning(stage, upper), (0, 1, 2, 3), 0.9, degree=degree):
        slipping, sticking = check_law(point.step)
        assert slipping > 0 < sticking and (point.step.scene.pairing.nonmatching != {}) == (upper == (4, 4, 2))
        forces.append(-contact_force(point.step))
        moments.append(-resultant(point.step).moment[2])
    x, y, _ = np.transpose(forces)
    assert x[1] > 0 and y[2] > 0 and moments[3] > 0
    assert abs(x[0]) < 1e-3 * x[1] and abs(y[1]) < 1e-3 * x[1] and abs(moments[2]) < 0.1 * moments[3]
    assert x[3] > 0.9 * x[1] and y[3] > 0.9 * y[2]


# ---------------------------------------------------------------------------------------- several contacts on a body


def corner(friction, cells, bevel):
    """A cube pushed down and sideways into a corner of a larger body; its edge there may be bevelled."""
    ell = join(block((0, 0, 0), (2, 1, 1), (2, 2, 1), 1), block((0, 0, 1), (1, 1, 2), (1, 2, 1), 1))
    ell = ell.named("floor", "top", where=lambda x: x[2] < 1.5).named("wall", "right", where=lambda x: x[0] < 1.5)

    def place(x):
        inwards = bevel * np.prod(np.maximum(0.0, 1 - 2 * (x[[0, 2]] - 1)), axis=0)
        return x[0] + inwards, x[1], x[2] + inwards

    cube = block((1, 0, 1), (2, 1, 2), cells, 1).placed(place)
    cube = cube.named("foot", "bottom", where=lambda x: x[2] < 1 + 1e-9)
    cube = cube.named("side", "left", where=lambda x: x[0] < 1 + 1e-9)
    contacts = [("ell floor", "cube foot"), ("ell wall", "cube side")]
    pairs = [ContactPair(*names, friction=mu) for names, mu in zip(contacts, friction)]
    held = Dirichlet("ell bottom", x=0.0, y=0.0, z=0.0), Dirichlet("cube top", x=-0.01, y=0.0, z=-0.01)
    return Scene(
        "corner", root_mesh_from_shapes({"ell": ell, "cube": cube}), {"ell": STEEL, "cube": STEEL}, held, pairs
    )


@pytest.mark.parametrize("friction", [(0.2, 0.2), (0.2, 0.0), (0.0, 0.2), (0.2, 0.5)])
def test_a_body_in_a_bevelled_corner(friction):
    """Each contact has its own coefficient, and one may have none."""
    step = next(adapt(corner(friction, (4, 3, 4), 0.1), 0.9))
    assert check_law(step)[0] > 0
    for number, mu in enumerate(friction):
        force = np.abs(contact_force(step, number))
        normal, shear = force[[2, 0]] if number == 0 else force[[0, 2]]
        assert normal > 0 and (0 < shear <= mu * normal * (1 + SOLVED) if mu else shear < SOLVED * normal)


APART = pytest.mark.xfail(
    raises=SolveError, strict=True, reason="rows beside the edge of surfaces meshed apart cycle"
)


@pytest.mark.parametrize("cells", [(1, 2, 1), pytest.param((2, 3, 3), marks=APART)], ids=["pairs", "mortar"])
def test_two_contacts_with_a_common_edge(cells):
    """A node of the edge has a normal of one contact along a tangent of the other."""
    step = next(adapt(corner((0.2, 0.2), cells, 0.0), 0.9, degree=1))
    assert sum(check_law(step)) > 0
    assert contact_force(step, 0)[2] > 0 and contact_force(step, 1)[0] > 0


# ---------------------------------------------------------------------------------- ties, symmetry, strain, materials


@pytest.mark.parametrize("degree", [1, 2])
def test_a_uniform_traction_beside_ties_and_symmetry_planes(degree):
    """Patch test of three blocks, the lower two glued, all meshed apart, between two planes of symmetry."""
    pressure, shear = 1e-2, 0.67 * MU * 1e-2
    heights, cells = {"ground": (-2, -1), "base": (-1, 0), "cube": (0, 1)}, {"ground": 2, "base": 3, "cube": 4}
    bodies = {
        name: block((0, 0, low), (1, 1, high), (cells[name], cells[name], 2), 1)
        for name, (low, high) in heights.items()
    }
    held = [Dirichlet("ground bottom", 0.0, 0.0, 0.0)]
    held += [SymmetryPlane(f"{body} {side}") for body in bodies for side in ("front", "back")]
    loads = [Traction("cube top", (shear, 0.0, -pressure))]
    loads += [
        Traction(f"{body} {side}", (0, 0, sign * shear))
        for body in bodies
        for side, sign in (("left", -1), ("right", 1))
    ]
    scene = Scene(
        "patch",
        root_mesh_from_shapes(bodies),
        dict.fromkeys(bodies, Material(2.0, 0.0)),
        held,
        ContactPair("cube bottom", "base top", friction=MU),
        loads,
        ties=Tie("base bottom", "ground top"),
    )
    step = next(adapt(scene, 0.9, degree=degree, solver=EXACT))
    assert len(scene.pairing.nonmatching) == 2
    everywhere(np.abs(tractions(step) - [shear, 0, 0]).max(initial=0.0) < 1e-10 * pressure, "another traction")
    assert step.record.slipping_pairs == 0


def heated_bar(thickness, heated):
    """Half of a bar of length 2 on a rough plane below a pressure p; heated, slip zones of length 1/2 grow."""
    pressure, count = 1e-4, round(1 / thickness)
    strain = heated * 0.5 * MU * pressure / thickness
    mesh = root_mesh_from_shapes({"bar": block((0, 0, 0), (1, thickness, thickness), (count, 1, 1), 1)})
    held = [SymmetryPlane(f"bar {side}") for side in ("left", "front", "back")]
    pair, load = ContactPair("bar bottom", GROUND, friction=MU), Traction("bar top", (0.0, 0.0, -pressure))
    materials, warm = {"bar": Material(1.0, 0.0)}, ThermalStrain("bar", 1.0, strain)
    return Scene("bar", mesh, materials, held, pair, load, strains=warm)


def test_a_heated_bar():
    """Equilibrium of a thin bar of thickness h: sigma' = mu p / h in slip zones of E eps_0 h / (mu p) from the ends.

    Cooled again it slips back in half of the zone, where its strain changes by twice the bound.  Errors are of the
    order of h, as the shear stress acts on the lower side alone.
    """
    h, zones, slips = 0.04, [], []
    for point in increments(lambda heated: heated_bar(h, heated), (1.0, 0.0), 0.9):
        step, rows = point.step, point.step.solution.rows
        check_law(step)
        x, slipping = rows.part(Role.NORMAL).position[:, 0], step.solution.slipping
        zones.append((largest(x[~slipping]), -largest(-x[slipping])))
        slips.append(largest(np.abs(step.solution.slip[rows.role == Role.TANGENT])))
        if point.value:
            shear, normal = contact_force(step)[0], -contact_force(step)[2]
            assert shear == pytest.approx(0.5 * MU * normal, rel=SOLVED)  # the stress in the middle is E eps_0
    for (sticks, slides), edge in zip(zones, (0.5, 0.75)):
        assert sticks < slides and edge - h / 2 < sticks and slides < edge + 1.5 * h, zones
    strain = 0.5 * MU * 1e-4 / h
    assert slips == pytest.approx([strain * 0.5 / 2, strain * 0.5 / 4], rel=2 * h)


@pytest.mark.parametrize("kind", ["pairs", "mortar"])
def test_a_nearly_incompressible_cube(kind):
    """nu = 0.4999, pressed onto a stiff base: the law holds, and slip is outwards."""
    upper = (2, 2, 2) if kind == "pairs" else (3, 3, 2)
    bodies = {"cube": block((0, 0, 0), (1, 1, 1), upper, 1), "base": block((0, 0, -1), (1, 1, 0), (2, 2, 2), 1)}
    materials = {"cube": Material(1.0, 0.4999), "base": Material(100.0, 0.3)}
    held = Dirichlet("base bottom", 0.0, 0.0, 0.0), Dirichlet("cube top", 0.0, 0.0, -1e-2)
    pair = ContactPair("cube bottom", "base top", friction=MU)
    step = next(adapt(Scene("soft", root_mesh_from_shapes(bodies), materials, held, pair), 0.9))
    assert min(check_law(step)) > 0
    outwards = step.solution.rows.part(Role.NORMAL).position - [0.5, 0.5, 0.0]
    sign = 1 if step.scene.oriented[0].surfaces[0] == "cube bottom" else -1
    slips = step.solution.slipping
    everywhere((sign * np.einsum("ni,ni->n", tractions(step), outwards) > 0)[slips].all(), "slip inwards")


@pytest.mark.parametrize("far", [False, True], ids=["touching", "far"])
def test_a_wall_beside_a_cube(far):
    """Surfaces of a frictionless wall in either order, at a common edge; one that is far away changes nothing."""
    gap = 0.5 if far else 0.0
    bodies = {
        "cube": block((0, 0, 0), (1, 1, 1), (2, 2, 2), 1),
        "base": block((0, 0, -1), (1, 1, 0), (2, 2, 2), 1),
        "wall": block((1 + gap, 0, 0), (2 + gap, 1, 1), (2, 2, 2), 1),
    }
    mesh, held = root_mesh_from_shapes(bodies), [
        Dirichlet(f"{name} bottom", 0.0, 0.0, 0.0) for name in ("base", "wall")
    ]
    found = []
    for walls in ((), ("cube right", "wall left"), ("wall left", "cube right")):
        pairs = [ContactPair("cube bottom", "base top", friction=0.9), *([ContactPair(*walls)] if walls else [])]
        items = {name: Material(1.0, 0.3) for name in bodies}, [*held, Dirichlet("cube top", -1e-3, 0.0, -0.01)]
        step = next(adapt(Scene("wall", mesh, *items, pairs), 0.9, degree=1))
        found.append(contact_force(step))
    alone, *both = found
    assert np.allclose(*both, rtol=1e-6, atol=1e-12)
    assert np.allclose(alone, both[0], rtol=1e-6, atol=1e-12) == far
