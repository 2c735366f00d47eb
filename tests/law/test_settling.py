"""Rigid obstacles that settle under forces: against exact solutions, and moved by the distance that is found."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import WORLD, everywhere
from mpi4py import MPI

from fx_contact import (
    ContactForce,
    ContactPair,
    Dirichlet,
    Displacement,
    Enforcement,
    Material,
    RigidCylinder,
    RigidPlane,
    RigidSphere,
    RigidSurface,
    Scene,
    SceneError,
    SolveError,
    Solver,
    SymmetryPlane,
    Traction,
    adapt,
    block,
    cylinder,
    root_mesh_from_shapes,
    solve,
    sweep,
)
from fx_contact.adaptive.beginning import Beginning
from fx_contact.results import true_error
from fx_contact.results.report import model_warnings
from fx_contact.scene.fingerprint import scene_parts
from fx_contact.verdict.solution_warnings import load_warnings

MATERIAL = Material(young=1.0, poisson=0.3)
BALL = RigidSphere((0.0, 0.0, 1.0), 1.0)

all_ranks = pytest.mark.ranks(1, 2, 3)


def block_scene(*pairs, held=None, body=None, symmetry=1):
    """A unit block below z = 0, by default a quarter of one that is held at its lower side."""
    mesh = root_mesh_from_shapes({"block": body or block((0, 0, -1), (1, 1, 0), (2, 2, 2), 1)})
    if held is None:
        held = SymmetryPlane("block left"), SymmetryPlane("block front"), Dirichlet("block bottom", z=0.0)
    return Scene("block", mesh, {"block": MATERIAL}, held, pairs, symmetry=symmetry)


def pressed(obstacle=BALL, force=1e-3, symmetry=4, **options):
    """A block below an obstacle pressed by a force downwards."""
    pair = ContactPair("block top", obstacle, force=(0.0, 0.0, -force), **options)
    return block_scene(pair, symmetry=symmetry)


def distance_of(record):
    """Distance of the one obstacle of a scene."""
    (distance,) = record.motions.values()
    return distance


def moved(scene, record):
    """The scene with its obstacles held where they have settled."""
    pairs = []
    for pair in scene.contact:
        distance = record.motions.get(pair.name)
        if distance is not None:
            there = np.array(pair.moved) - distance * pair.unit_direction
            pair = replace(pair, moved=tuple(there.tolist()), direction=tuple(pair.unit_direction), force=None)
        pairs.append(pair)
    return replace(scene, contact=tuple(pairs))


def check_alike(step, near=1e-6, **options):
    """The obstacle moved by the distance of a step leads to the same displacement and force on its leaves."""
    record, begin = step.record, Beginning(step.forest, step.nodal_displacement)
    other, *_ = adapt(moved(step.scene, record), record.tolerance, degree=record.degree, beginning=begin, **options)
    off = step.solution.displacement - other.solution.displacement
    largest = WORLD.allreduce(float(np.abs(step.solution.displacement).max(initial=0.0)), op=MPI.MAX)
    everywhere(np.abs(off).max(initial=0.0) < near * largest, "other displacements")
    assert np.allclose(record.pair_forces, other.record.pair_forces, rtol=near)
    assert not other.record.motions


# ------------------------------------------------------------------------------------------------- exact solutions


@all_ranks
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("method", ["exact", "penalty"])
def test_uniform_pressure(degree, method):
    """A plane on a block: t = F/E; the force is exact, also for a penalty, and of all four parts."""
    plane = RigidPlane((5.0, 0.0, 0.3), (0.0, 0.0, -2.0))
    step = next(adapt(pressed(plane, 0.04), 0.1, degree=degree, enforcement=Enforcement(method)))
    record = step.record
    assert abs(record.force / 0.04 - 1) < 1e-7 and record.pair_forces == [record.force]
    assert abs(distance_of(record) / 0.31 - 1) < (1e-7 if method == "exact" else 1e-3)
    (contact,) = (one for one in step.resultants if one.kind == "contact")
    assert np.allclose(contact.force, (0, 0, record.force), rtol=0, atol=1e-9)
    assert not model_warnings(record)


def test_a_ball_on_a_block():
    """Hertz on a block 60 contact radii wide, approach within the block's compliance; the same as the ball moved."""
    mesh = root_mesh_from_shapes({"block": block((0, 0, -1), (1, 1, 0), (3, 3, 3), 1)})
    force, modulus = 4.6e-5, MATERIAL.plane_strain_modulus
    scene = replace(pressed(force=force), mesh=mesh)
    step = solve(scene, 0.1)
    record = step.record
    assert record.reached and abs(record.force / force - 1) < 1e-7
    hertz = (0.75 * force / modulus) ** (2 / 3)
    assert abs(distance_of(record) / hertz - 1) < 0.05
    assert abs(record.contact_radius / (0.75 * force / modulus) ** (1 / 3) - 1) < 0.03
    check_alike(step)


def punch(**options):
    """A plane on a quarter of the upper side of a block."""
    body = block((0, 0, -1), (1, 1, 0), (2, 2, 2), 1).named("foot", "top", where=lambda x: x[:2].max(axis=0) < 0.51)
    pair = ContactPair("block foot", RigidPlane((0.0, 0.0, 0.0), (0.0, 0.0, -1.0)), **options)
    return block_scene(pair, body=body, symmetry=4)


def test_a_flat_punch():
    """The distance is proportional to the force, by the stiffness of the moved punch."""
    known = next(adapt(punch(moved=(0.0, 0.0, -0.01)), 0.1)).record
    for force in (1e-4, 0.02):
        record = next(adapt(punch(force=(0.0, 0.0, -force)), 0.1)).record
        assert abs(distance_of(record) / (force / known.force * 0.01) - 1) < 1e-6


# ------------------------------------------------------------------------------------------- the same as if it is moved


def bolt_in_a_bore():
    """Half a slice of a bolt, held in its middle, that a bore with play is pulled against."""
    mesh = root_mesh_from_shapes({"bolt": cylinder(1.0, 0.25, (2, 1), 4, quarters=1)})
    planes = tuple(SymmetryPlane(f"bolt {side}") for side in ("x = 0", "bottom", "top"))
    bore = RigidCylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), -1.01)
    pair = ContactPair("bolt outside", bore, force=(0.0, -2e-3, 0.0))
    return Scene("bolt", mesh, {"bolt": MATERIAL}, (*planes, Dirichlet("bolt y = 0", y=0.0)), (pair,), symmetry=2)


def two_obstacles():
    """A block below a ball and beside a plane, which do not touch it at first, one of them beside a third obstacle."""
    pairs = (
        ContactPair("block right", RigidPlane((1.1, 0, 0), (-1, 0, 0)), force=(-4e-3, 0, 0)),
        ContactPair("block top", RigidSphere((0.2, 0.3, 1.5), 1.0), force=(0, 0, -1e-3)),
        ContactPair("block bottom", RigidPlane((0, 0, -1), (0, 0, 1))),
    )
    return block_scene(*pairs, held=(Dirichlet("block left", x=0.0), SymmetryPlane("block front")))


def dented():
    """A ball under a light force in a block that a traction bends: it begins far from its place, inside the block."""
    scene = pressed(RigidSphere((0.0, 0.0, 0.8), 1.0), 1e-5)
    return replace(scene, tractions=(Traction("block right", (0.02, 0.0, 0.01)),))


SCENES = {
    "ball": pressed,
    "bore": bolt_in_a_bore,
    "two": two_obstacles,
    "dented": dented,
    "rubber": lambda: replace(pressed(), materials={"block": Material(1.0, 0.4999)}),
    "oblique": lambda: pressed(RigidPlane((0.0, 0.0, 0.2), (0.2, 0.1, -1.0)), symmetry=1),
}


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("name", SCENES)
def test_as_if_moved(name, degree):
    """Refined once: forces as prescribed, displacements and forces of the obstacles where they have settled."""
    scene = SCENES[name]()
    *_, step = adapt(scene, 0.2, degree=degree, max_steps=2)
    wanted = [None if pair.force is None else np.linalg.norm(pair.force) for pair in scene.contact]
    assert [*step.record.motions] == [pair.name for pair in step.scene.contact if pair.force is not None]
    for found, force in zip(step.record.pair_forces, wanted):
        assert force is None or abs(found / force - 1) < 1e-6
    check_alike(step)


@pytest.mark.parametrize("options", [{"enforcement": Enforcement("penalty")}, {"solver": Solver("cholesky")}])
def test_other_enforcement_and_solver(options):
    """A penalty, whose closed rows change their normals in the matrix, and factors."""
    *_, step = adapt(pressed(), 0.2, max_steps=2, **options)
    assert abs(step.record.force / 1e-3 - 1) < 1e-7
    check_alike(step, **options)


def test_from_an_undeformed_fine_mesh():
    """The first guess of the indentation is close: fewer active sets than twice those of the ball that is held."""
    scene = pressed(force=4e-3)
    step = next(adapt(scene, 0.3, degree=1, beginning=Beginning.uniform(scene, 3)))
    assert step.record.active_pairs > 5 and step.record.contact_iterations < 12


def test_a_thin_plate():
    """A ball on a clamped plate of 1:200."""
    body = block((0, 0, -0.005), (1, 1, 0), (8, 8, 1), 1)
    held = SymmetryPlane("block left"), SymmetryPlane("block front"), Dirichlet("block back", x=0.0, y=0.0, z=0.0)
    held = (*held, Dirichlet("block right", x=0.0, y=0.0, z=0.0))
    pair = ContactPair("block top", RigidSphere((0.0, 0.0, 0.5), 0.5), force=(0.0, 0.0, -1e-8))
    for step in adapt(block_scene(pair, held=held, body=body, symmetry=4), 0.1, max_steps=2):
        assert abs(step.record.force / 1e-8 - 1) < 1e-6
        # Timoshenko and Woinowsky-Krieger: w = 0.0056 F a^2 / D, of a square with the side a = 2.
        assert abs(distance_of(step.record) / (0.0056 * 1e-8 * 4 / (0.005**3 / 12 / 0.91)) - 1) < 0.05


# ---------------------------------------------------------------------------------------------------- errors and goals


def test_goals_where_the_obstacle_gives_way():
    """A point below a flat punch moves with it: its estimated error is that of the distance, not that if it is held."""
    scene = punch(force=(0.0, 0.0, -0.02))
    goals = Displacement((0, 0, 0), (0, 0, 1), 0.03), ContactForce("block foot on rigid plane", 0.03)
    record = solve(scene, 0.3, degree=1, goals=goals).record
    known = distance_of(solve(scene, 0.08).record)
    place, force = record.goals
    assert record.reached and abs(-place.value / distance_of(record) - 1) < 1e-7
    error = abs(distance_of(record) / known - 1)
    for goal in (place, force):  # for a flat punch relative errors of distance and force are the same
        assert 0.5 < goal.error / abs(goal.value) / error < 4


def test_true_error():
    """The over-refined solution settles too."""
    *_, step = adapt(pressed(), 0.2, degree=2, max_steps=2)
    assert 0.5 < step.record.estimate / true_error(step, 0.05).relative < 2


# ------------------------------------------------------------------------------------------ load paths and restarts


@all_ranks
def test_a_load_path(folder):
    """The force grows: each point begins with the distance of the one before, and after a restart too."""
    forces = [1e-3, 2e-3, 3e-3]
    options = {"tolerance": 0.3, "degree": 1, "folder": folder}
    first = list(sweep(lambda force: pressed(force=force), forces[:2], **options))
    assert [point.record.begun for point in first] == ["anew", "coarse"]
    (last,) = sweep(lambda force: pressed(force=force), forces, restart=True, **options)
    found = [distance_of(point.step.record) for point in (*first, last)]
    assert found == sorted(found) and last.record.begun == "coarse"
    known = solve(pressed(force=3e-3), 0.3, degree=1).record
    assert abs(found[-1] / distance_of(known) - 1) < 0.3**2


def test_a_path_to_another_kind_of_load():
    """A ball that is moved, and one below a force, begin anew."""
    held = pressed().contact[0]
    held = replace(held, force=None, moved=(0.0, 0.0, -0.01))
    points = sweep(lambda force: pressed(force=force) if force else block_scene(held), (0.0, 1e-3), 0.5, degree=1)
    assert [point.record.begun for point in points] == ["anew", "anew"]


# ---------------------------------------------------------------------------------------------------------- bad input


def test_a_force_is_a_load():
    """The scene has a load, and another fingerprint than without."""
    assert not load_warnings(pressed())
    alone = block_scene(replace(pressed().contact[0], force=None), symmetry=4)
    assert load_warnings(alone) and scene_parts(alone) != scene_parts(pressed())


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: ContactPair("a", BALL, force=(0, 0, 0)), "force on the obstacle below 'a' is zero"),
        (lambda: ContactPair("a", BALL, force=(0, np.nan, 1)), "finite"),
        (lambda: ContactPair("a", "b", force=(0, 0, 1)), "no obstacle that a force could press"),
        (lambda: ContactPair("a", BALL, (0, 0, 1), force=(0, 0, -1)), "leave `direction` away"),
        (lambda: block_scene(ContactPair("block top", BALL, force=(1e-3, 0, -1e-3))), "crosses the symmetry plane"),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(SceneError, match=message):
        make()


@pytest.mark.parametrize("motions", [(), {}, {"block": 0.1}, {pressed().contact[0].name: "much"}, 0.1])
def test_bad_beginnings(motions):
    begin = replace(Beginning.uniform(pressed(), 0), motions=motions)
    with pytest.raises(SceneError, match="motion"):
        adapt(pressed(), 0.1, beginning=begin)


@all_ranks
@pytest.mark.parametrize(
    "scene, message",
    [
        (pressed(force=10.0), "pressed it through the body; reverse the force, or check the place"),
        (
            pressed(RigidSurface(lambda x: np.maximum(0.1 - x[2], 0.05), lambda x: 0 * x - [[0], [0], [1]])),
            "misses the surface",
        ),
    ],
)
def test_obstacles_that_do_not_settle(scene, message):
    """An error on all ranks: a force a thousand times too large, and a gap that does not fall as the obstacle moves."""
    with pytest.raises(SolveError, match=message):
        solve(scene, 0.2)
