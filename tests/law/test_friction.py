"""Friction: stick and slip against exact solutions, history, and what cannot be."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import WORLD, everywhere
from friction_checks import check_law, contact_force, forces, total, tractions
from model_problems import grown, roots
from mpi4py import MPI

from fx_contact import (
    Beginning,
    ContactPair,
    Dirichlet,
    Enforcement,
    Material,
    RigidPlane,
    Scene,
    SceneError,
    SolveError,
    Solver,
    SymmetryPlane,
    Traction,
    Tresca,
    adapt,
    ball,
    block,
    increments,
    root_mesh_from_shapes,
)
from fx_contact.contact.constraint_rows import Role
from fx_contact.scenes import punch

pytestmark = pytest.mark.ranks(1, 2, 3)

EXACT = Solver(tolerance=1e-12)
MU, PRESSURE = 0.3, 1e-2
#: Coulomb's bound of the traction below `PRESSURE`, once by each law.
LAWS = [MU, Tresca(MU * PRESSURE)]
PLANE = RigidPlane((0, 0, 0), (0, 0, 1))


def cubes(kind, friction, poisson=0.0, **items):
    """A cube on another one, meshed alike or apart, or on a rigid plane."""
    upper = (3, 3, 2) if kind == "mortar" else (2, 2, 2)
    bodies = {"cube": block((0, 0, 0), (1, 1, 1), upper, 1)}
    held = [*items.pop("held", ())]
    if kind != "obstacle":
        bodies["base"] = block((0, 0, -1), (1, 1, 0), (2, 2, 2), 1)
        held.append(Dirichlet("base bottom", 0.0, 0.0, 0.0))
    pair = ContactPair("cube bottom", PLANE if kind == "obstacle" else "base top", friction=friction)
    materials = dict.fromkeys(bodies, Material(2.0, poisson))
    return Scene("cubes", root_mesh_from_shapes(bodies), materials, held, pair, **items)


def loaded(kind, friction, shear):
    """Uniform compression, and uniform shear by tractions (shear, 0) on all surfaces; nothing but friction holds it."""
    bodies = ("cube",) if kind == "obstacle" else ("cube", "base")
    loads = [Traction("cube top", (shear, 0.0, -PRESSURE))]
    loads += [Traction(f"{body} {side}", (0.0, 0.0, sign * shear)) for body in bodies for side, sign in SIDES]
    return cubes(kind, friction, tractions=loads)


SIDES = ("left", -1), ("right", 1)


@pytest.mark.parametrize("law", LAWS, ids=["Coulomb", "Tresca"])
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("kind", ["pairs", "mortar", "obstacle"])
def test_a_uniform_traction(kind, degree, law):
    """Two thirds of the bound: all nodes stick, with the traction of the load, also around hanging nodes."""
    shear = 0.67 * MU * PRESSURE
    scene = loaded(kind, law, shear)
    begin = Beginning.at_rest(grown(roots(scene), 2, share=0.2))
    step = next(adapt(scene, 0.9, degree=degree, solver=EXACT, beginning=begin))
    found = tractions(step)
    everywhere(np.abs(found - [shear, 0, 0]).max(initial=0.0) < 1e-10 * PRESSURE, "another traction")
    record = step.record
    assert record.slipping_pairs == 0 and record.sticking_pairs == record.active_pairs > 0
    assert abs(record.dissipated_energy) < 1e-15 and f"{record.sticking_pairs} nodes stick, 0 slip" in str(step)


def pushed(kind, friction, shift, poisson=0.3):
    """The top is pressed down and moved by a vector, so far that all nodes slip."""
    return cubes(kind, friction, poisson, held=[Dirichlet("cube top", *shift, -1e-2)])


@pytest.mark.parametrize("kind", ["pairs", "mortar", "obstacle"])
def test_onset_of_sliding(kind):
    """Far beyond the onset all nodes slip in the direction of the motion, with mu times the normal force."""
    angle = 0.7
    shift = 0.1 * np.cos(angle), 0.1 * np.sin(angle)
    step = next(adapt(pushed(kind, MU, shift), 0.9, solver=EXACT, allow=("large strain", "large rotation")))
    x, y, z = contact_force(step)
    assert total(np.linalg.norm(forces(step), axis=1)) == pytest.approx(-MU * z, rel=1e-8)
    assert np.hypot(x, y) == pytest.approx(-MU * z, rel=1e-3) and np.arctan2(y, x) == pytest.approx(angle, abs=0.05)
    assert step.record.sticking_pairs == 0 and step.record.slipping_pairs > 0
    assert step.record.dissipated_energy > 0


def test_a_bound_of_tresca():
    """Where all slip, the tangential force is the bound times the area, whatever the pressure."""
    step = next(
        adapt(pushed("obstacle", Tresca(1e-3), (0.1, 0.0), 0.0), 0.9, allow=("large strain", "large rotation"))
    )
    assert contact_force(step)[0] == pytest.approx(1e-3, rel=1e-8)


def test_a_bound_of_tresca_above_the_pressure():
    """Tractions are at most the pressure: the forces along and across are equal where all slip."""
    step = next(
        adapt(pushed("obstacle", Tresca(1.0), (0.1, 0.0), 0.0), 0.9, allow=("large strain", "large rotation"))
    )
    assert total(np.linalg.norm(forces(step), axis=1)) == pytest.approx(-contact_force(step)[2], rel=1e-6)


def fretting(mu, shift, second=PLANE):
    """Half of a ball pressed on a plane or a stiff block, and moved along y."""
    top = ball(1.0, 2, 3, 2).placed(lambda x: (x[0], -x[1], 1.0 - x[2]))
    bodies, held = {"ball": top}, [Dirichlet("ball z = 0", 0.0, shift, -0.01), SymmetryPlane("ball x = 0")]
    materials = {"ball": Material(1.0, 0.3)}
    if second != PLANE:
        bodies["base"], materials["base"] = block((0, -1, -1), (1, 1, 0), (4, 8, 4), 3), Material(100.0, 0.3)
        held += [Dirichlet("base bottom", 0.0, 0.0, 0.0), SymmetryPlane("base left")]
    pair = ContactPair("ball outside", second, friction=mu)
    return Scene("fretting", root_mesh_from_shapes(bodies), materials, held, pair, symmetry=2)


@pytest.mark.parametrize("second", [PLANE, "base top"], ids=["plane", "mortar"])
def test_stick_and_slip(second):
    """The law holds at each node of a ball in fretting; the slip zone grows from the edge; unloading dissipates too."""
    found = []
    options = {"degree": 1, "max_steps": 2}
    for point in increments(lambda shift: fretting(0.5, shift, second), (0.0, 2e-3, 4e-3, 2e-3), 0.2, **options):
        slipping, sticking = check_law(point.step)
        found.append((slipping, sticking, contact_force(point.step)[1]))
    slipping, sticking, shear = zip(*found)
    assert abs(shear[0]) < 1e-10 and 0 < shear[1] < shear[2] > shear[3], shear
    assert sticking[1] > sticking[2] > 0 and slipping[2] > slipping[1], found
    loading, unloading = shear[2] - shear[1], shear[2] - shear[3]
    assert unloading > loading, "no hysteresis"


def test_the_same_on_any_number_of_ranks(folder):
    """Statuses and forces of a path, also after a restart."""
    options = {"tolerance": 0.15, "degree": 1, "max_steps": 2}
    shifts = 0.0, 2e-3, 4e-3
    alone = [
        point.step.record for point in increments(lambda s: fretting(0.5, s), shifts, comm=MPI.COMM_SELF, **options)
    ]
    found = [p.step.record for p in increments(lambda s: fretting(0.5, s), shifts[:2], folder=folder, **options)]
    again = increments(lambda s: fretting(0.5, s), shifts, folder=folder, restart=True, **options)
    found += [point.step.record for point in again]
    for one, other in zip(found, alone, strict=True):
        assert (one.cells, one.sticking_pairs, one.slipping_pairs) == (
            other.cells,
            other.sticking_pairs,
            other.slipping_pairs,
        )
        forces = (record.resultants[0].force for record in (one, other))
        assert next(forces) == pytest.approx(next(forces), rel=1e-7, abs=1e-10)


def test_a_ball_that_nothing_drives_has_no_shear():
    """Pressed alone it has a symmetric traction, which points outwards."""
    step = next(adapt(fretting(0.5, 0.0), 0.9, degree=1))
    assert abs(contact_force(step)[1]) < 1e-10
    assert WORLD.allreduce(float(np.abs(tractions(step)).max(initial=0.0)), op=MPI.MAX) > 0


@pytest.mark.parametrize("kind", ["pairs", "mortar", "obstacle"])
def test_a_body_held_by_friction(kind):
    """A block that would slide without it keeps its place below mu, and ends in a sentence beyond."""
    held = cubes(kind, MU, 0.3, tractions=[Traction("cube top", (0.8 * MU * PRESSURE, 0.0, -PRESSURE))])
    step = next(adapt(held, 0.9, degree=1))
    x, y, z = contact_force(step)
    assert (x, y, z) == pytest.approx((0.8 * MU * PRESSURE, 0.0, -PRESSURE), abs=1e-6 * PRESSURE)
    beyond = replace(held, tractions=[Traction("cube top", (1.3 * MU * PRESSURE, 0.0, -PRESSURE))])
    with pytest.raises(SolveError, match="carries about"):
        next(adapt(beyond, 0.9, degree=1))


@pytest.mark.parametrize("part", [1.001, 1.01, 1.03])
def test_a_body_just_beyond_friction(part):
    """It carries mu N, less than what is needed, also where an edge opens."""
    load = Traction("cube top", (part * MU * PRESSURE, 0.0, -PRESSURE))
    with pytest.raises(SolveError, match="slides or tips.* friction carries about 0.003 of 0.003"):
        next(adapt(cubes("pairs", MU, tractions=[load]), 0.9, degree=1))


def test_a_body_that_tips_or_is_lifted():
    """Friction would carry the load of the former; nothing holds the latter."""
    tips = cubes("pairs", 3 * MU, tractions=[Traction("cube top", (0.6 * PRESSURE, 0.0, -PRESSURE))])
    with pytest.raises(SolveError, match="slides or tips.* friction carries about [^ ]+; .*resultant inside"):
        next(adapt(tips, 0.9, degree=1))
    held = Dirichlet("cube left", x=0.0), Dirichlet("cube front", y=0.0)
    lifted = cubes("pairs", MU, held=held, tractions=[Traction("cube top", (0.0, 0.0, PRESSURE / 10))])
    with pytest.raises(SolveError, match="nothing holds body 'cube' along z: a load drives"):
        next(adapt(lifted, 0.9, degree=1))


def test_tangents_on_planes_of_symmetry():
    """The mean normals of a curved surface are oblique to the planes, tangents are not: at the axis there are none."""
    scene = punch()
    step = next(adapt(replace(scene, contact=replace(scene.contact[0], friction=0.5)), 0.9, degree=1))
    rows = step.solution.rows
    tangents = rows.part(Role.TANGENT)
    on_planes = np.abs(tangents.position[:, :2]) < 1e-12
    assert total(on_planes) > 4 and total(np.abs(rows.part(Role.NORMAL).normal[:, :2]).max(axis=1) > 1e-3) > 0
    everywhere(np.abs(tangents.normal[:, :2])[on_planes].max(initial=0.0) < 1e-12, "oblique to a plane")
    assert total(~tangents.normal[on_planes.all(axis=1)].any(axis=1)) == 2
    check_law(step)


@pytest.mark.ranks(1)
def test_no_friction_is_no_law():
    """0 has neither rows nor entries in the record."""
    scenes = fretting(0.0, 1e-3), replace(fretting(0.0, 1e-3), contact=ContactPair("ball outside", PLANE))
    steps = [next(adapt(scene, 0.9, degree=1)) for scene in scenes]
    assert not (steps[0].solution.rows.role == Role.TANGENT).any()
    one, two = (
        {n: v for n, v in s.record.as_json().items() if "seconds" not in n and "memory" not in n} for s in steps
    )
    assert one == two and "slipping_pairs" not in one


@pytest.mark.parametrize("friction", [-0.1, np.nan, "0.3", True, None])
def test_no_such_friction(friction):
    """A coefficient is a number from 0 on."""
    with pytest.raises(SceneError, match="friction"):
        ContactPair("a", "b", friction=friction)


def test_impossible_friction():
    """A bound is positive; friction goes with exact contact and obstacles at given places."""
    with pytest.raises(SceneError, match="bound of Tresca"):
        Tresca(0.0)
    with pytest.raises(SceneError, match="an obstacle that a force moves"):
        ContactPair("a", PLANE, force=(0, 0, -1), friction=0.1)
    with pytest.raises(SceneError, match="friction needs the enforcement 'exact'"):
        adapt(fretting(0.5, 0.0), 0.5, enforcement=Enforcement("penalty"))


def test_an_obstacle_that_moves():
    """It slides as the body that moves the other way, also in steps from the place before."""

    def moved(body, plane):
        """The scene of a displacement of the body or of the plane."""
        held, pair = [Dirichlet("cube top", body, 0.0, -0.01)], {"moved": (plane, 0.0, 0.0)}
        scene = cubes("obstacle", MU, 0.3, held=held)
        return replace(scene, contact=replace(scene.contact[0], **pair))

    shifts, options = (0.0, 1e-3, 2e-3, 1e-3), {"degree": 1, "max_steps": 1}
    one, other = (
        [contact_force(point.step) for point in increments(of, shifts, 0.9, **options)]
        for of in (lambda s: moved(-s, 0.0), lambda s: moved(0.0, s))
    )
    assert np.allclose(one, other, rtol=1e-6, atol=1e-9) and one[3][0] > one[2][0] < -1e-5


def test_unloaded_in_the_end():
    """The last increment may have no load."""

    def pressed(down):
        """The cube pressed by a displacement."""
        return cubes("pairs", MU, 0.3, held=[Dirichlet("cube top", 0.0, 0.0, -down)])

    *_, point = increments(pressed, (1e-2, 0.0), 0.9, degree=1, max_steps=1)
    assert point.record.record.force < 1e-12 and point.record.begun == "before"


@pytest.mark.ranks(1)
@pytest.mark.parametrize("mu, poisson, solves, iterations", [(0.6, 0.3, 12, 45), (1.0, 0.0, 17, 60)])
def test_linear_solves_of_a_load_step(mu, poisson, solves, iterations):
    """With one tight tolerance there are 64 and 96 iterations, without acceleration 9 and 19 solves."""
    materials = {"ball": Material(1.0, poisson)}
    path = increments(lambda s: replace(fretting(mu, s), materials=materials), (0.0, 2e-3), 0.05, max_steps=2)
    found = list(path)[-1].record.record.krylov_iterations
    assert len(found) <= solves and sum(found) <= iterations, found
