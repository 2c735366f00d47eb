"""Ties: parts that are glued act as one, whatever the meshes of their surfaces, and transmit section forces."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import gathered, refined_around
from mpi4py import MPI

from fx_contact import (
    ContactPair,
    Dirichlet,
    Displacement,
    Enforcement,
    Material,
    Pressure,
    Reaction,
    Scene,
    SceneError,
    SolveError,
    Solver,
    SymmetryPlane,
    Tie,
    Traction,
    adapt,
)
from fx_contact.geometry.shapes import join, root_mesh_from_shapes
from fx_contact.geometry.solids import block
from fx_contact.law import active_set
from fx_contact.scene.fingerprint import scene_parts

all_ranks = pytest.mark.ranks(1, 2, 3)

YOUNG, POISSON = 1.0, 0.3
MATERIAL = Material(YOUNG, POISSON)
OUTWARD = {
    "right": (1, 0, 0),
    "left": (-1, 0, 0),
    "back": (0, 1, 0),
    "front": (0, -1, 0),
    "top": (0, 0, 1),
    "bottom": (0, 0, -1),
}
#: A strain with six different components.
STRAIN = 1e-3 * np.array([[1.0, 0.3, -0.4], [0.3, -0.5, 0.2], [-0.4, 0.2, 0.7]])
STRESS = YOUNG / (1 + POISSON) * (STRAIN + POISSON / (1 - 2 * POISSON) * np.trace(STRAIN) * np.eye(3))
TIGHT = Solver(tolerance=1e-12)


def cubes(lows, counts):
    """Unit cubes "a", "b", ... at low corners, of n x n x n cells each."""
    names = "abcdefgh"[: len(lows)]
    shapes = (block(low, np.add(low, 1), (n, n, n), 1) for low, n in zip(lows, counts))
    return root_mesh_from_shapes(dict(zip(names, shapes)))


def strained(mesh, ties, held):
    """Bodies of the uniform `STRAIN`: displacements prescribed at `held`, tractions on all other sides but the ties."""
    values = dict(zip("xyz", (lambda x, row=row: row @ x for row in STRAIN)))
    inside = {name for tie in ties for name in tie.surfaces}
    tractions = tuple(
        Traction(f"{body} {side}", tuple(STRESS @ np.array(normal)))
        for body in mesh.bodies
        for side, normal in OUTWARD.items()
        if f"{body} {side}" not in inside | set(held)
    )
    conditions = tuple(Dirichlet(where, **values) for where in held)
    return Scene("strained", mesh, dict.fromkeys(mesh.bodies, MATERIAL), conditions, ties=ties, tractions=tractions)


def positions(step):
    """Undeformed positions of the owned conforming nodes."""
    prolongation = step.elasticity.prolongation
    return prolongation.injected(prolongation.space.positions())


def off(step, exact):
    """Largest difference from an exact displacement (owned, 3), relative to its largest component."""
    own = (float(np.abs(values).max(initial=0.0)) for values in (step.solution.displacement - exact, exact))
    difference, largest = (WORLD.allreduce(value, op=MPI.MAX) for value in own)
    return difference / largest


def of_kind(step, kind):
    """Forces and moments (6,) of the resultants of a kind, by name."""
    return {r.name: np.array([*r.force, *r.moment]) for r in step.resultants if r.kind == kind}


def everything(step):
    """Positions and displacements of all conforming nodes on every rank, by position."""
    rows = gathered(WORLD, np.column_stack([positions(step), step.solution.displacement]))
    return rows[np.lexsort(np.rint(rows[:, :3] * 1e6).T)]


def leaves(step):
    """Centres and levels of all leaves, sorted."""
    rows = gathered(WORLD, np.column_stack([step.forest.centres, step.forest.level]))
    return rows[np.lexsort(np.rint(rows * 1e6).T)]


@all_ranks
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("counts", [(3, 3), (4, 3), (3, 4)], ids=["alike", "4:3", "3:4"])
@pytest.mark.parametrize("refined", ["", "a", "b"], ids=["none", "first", "second"])
def test_uniform_strain(degree, counts, refined):
    """All six components pass, with hanging nodes on either side; the section force is the stress times the area.

    Displacements are prescribed on one end, and then on sides that the tie meets.
    """
    mesh, ties = cubes([(0, 0, 1), (0, 0, 0)], counts), (Tie("a bottom", "b top"),)
    for held in (["b bottom"], ["a left", "b left", "a front", "b front"]):
        scene = strained(mesh, ties, held)
        assert bool(scene.pairing.nonmatching) == (counts[0] != counts[1])
        step = next(
            adapt(scene, 0.9, degree=degree, solver=TIGHT, beginning=refined_around(scene, (0, 0, 1), refined))
        )
        assert (step.record.hanging_nodes > 0) == bool(refined)
        assert off(step, positions(step) @ STRAIN) < 1e-10
        assert step.record.active_pairs == 0 and step.rows is None and step.record.doubts == []
        if held == ["b bottom"]:
            (force,) = of_kind(step, "tie").values()
            assert np.abs(force[:3] - STRESS[2]).max() < 1e-10 * np.abs(STRESS).max()


@all_ranks
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("counts", [(2, 2, 2, 2), (3, 2, 2, 3), (2, 2, 2, 3)], ids=["alike", "apart", "both"])
def test_four_ties_at_an_edge(degree, counts):
    """Four cubes around an edge, each tied to two others: rows of its nodes depend on each other."""
    mesh = cubes([(0, 0, 0), (1, 0, 0), (0, 0, 1), (1, 0, 1)], counts)
    ties = Tie("a right", "b left"), Tie("c right", "d left"), Tie("a top", "c bottom"), Tie("b top", "d bottom")
    scene = strained(mesh, ties, ["a bottom"])
    assert len(scene.pairing.nonmatching) == {(2, 2, 2, 2): 0, (3, 2, 2, 3): 4, (2, 2, 2, 3): 2}[counts]
    step = next(adapt(scene, 0.9, degree=degree, solver=TIGHT))
    assert off(step, positions(step) @ STRAIN) < 1e-10
    for tie, force in of_kind(step, "tie").items():
        normal = OUTWARD["right" if "right" in tie else "top"]
        assert np.abs(force[:3] + STRESS @ normal).max() < 1e-10 * np.abs(STRESS).max(), tie


def bar(mesh, ties=(), load=(0.0, 2e-4, 1e-4), **changes):
    """A bar of 4 x 1 x 1 along x, clamped at its left end, with a load at the other."""
    first, last = mesh.bodies[0], mesh.bodies[-1]
    held, pull = (Dirichlet(f"{first} left", x=0.0, y=0.0, z=0.0),), (Traction(f"{last} right", load),)
    scene = Scene("bar", mesh, dict.fromkeys(mesh.bodies, MATERIAL), held, tractions=pull, ties=ties)
    return replace(scene, **changes)


def whole(n=2):
    """A bar of one mesh."""
    return root_mesh_from_shapes({"bar": block((0, 0, 0), (4, 1, 1), (4 * n, n, n), 1)})


def cut(n=2, other=None):
    """The bar in two, "base" and "tip", meshed alike or with another number of cells."""
    m = n if other is None else other
    parts = block((0, 0, 0), (2, 1, 1), (2 * n, n, n), 1), block((2, 0, 0), (4, 1, 1), (2 * m, m, m), 1)
    return root_mesh_from_shapes(dict(zip(("base", "tip"), parts)))


TIED = (Tie("base right", "tip left"),)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("order", [1, -1], ids=["as it is", "exchanged"])
def test_a_bar_cut_in_two(degree, order):
    """Tied where both meshes are alike it has the displacements of one mesh, with hanging nodes across the cut."""
    ties = (Tie(*TIED[0].surfaces[::order]),)
    one, two = bar(whole()), bar(cut(), ties)
    begin = {scene: refined_around(scene, (2, 0, 0)) for scene in (one, two)}
    steps = [next(adapt(scene, 0.9, degree=degree, solver=TIGHT, beginning=begin[scene])) for scene in (one, two)]
    assert steps[1].record.hanging_nodes > 0 and np.array_equal(*map(leaves, steps))
    single, double = map(everything, steps)
    known = {tuple(row[:3].round(6)): row[3:] for row in single}
    assert len(double) > len(single)
    largest = np.abs(single[:, 3:]).max()
    assert max(np.abs(row[3:] - known[tuple(row[:3].round(6))]).max() for row in double) < 1e-9 * largest


def test_a_bar_cut_in_two_is_refined_alike():
    """The singular edges of the clamp decide: at degree 2 all meshes of the run have the same leaves."""
    runs = [list(adapt(scene, 0.015, degree=2)) for scene in (bar(whole()), bar(cut(), TIED))]
    one, two = ([step for step in steps if step.record.cells > 32] for steps in runs)
    assert len(one) == len(two) > 2
    assert all(np.array_equal(leaves(a), leaves(b)) for a, b in zip(one, two))


@pytest.mark.parametrize("other", [None, 3], ids=["alike", "2:3"])
def test_section_forces(other):
    """Force and moment through the cut are those of the load, in whichever order the surfaces are named."""
    load = np.array([3e-4, 2e-4, 1e-4])
    for order in (1, -1):
        tie = Tie(*TIED[0].surfaces[::order])
        step = next(adapt(bar(cut(2, other), (tie,), tuple(load)), 0.9, degree=1, solver=TIGHT))
        (found,) = of_kind(step, "tie").values()
        (pull,) = of_kind(step, "traction").values()
        assert np.abs(pull[:3] - load).max() < 1e-12 and np.abs(pull[3:]).max() > 1e-4
        # The tip pulls the base as the load pulls the tip; the moment is about the same point.
        assert np.abs(found + order * pull).max() < 1e-9 * np.abs(pull).max()
        assert all(np.abs(balance).max() < 1e-12 for balance in of_kind(step, "balance").values())


def test_springs_in_series():
    """Two materials under tension: u = F (L/E + L/E') / A exactly."""
    mesh, modulus = cut(2, 3), {"base": 1.0, "tip": 50.0}
    materials = {name: Material(value, 0.0) for name, value in modulus.items()}
    for ties in (TIED, (Tie("tip left", "base right"),)):
        step = next(adapt(bar(mesh, ties, (1e-3, 0.0, 0.0), materials=materials), 0.9, degree=1, solver=TIGHT))
        x = positions(step)[:, 0]
        exact = 1e-3 * (np.minimum(x, 2) / modulus["base"] + np.maximum(x - 2, 0) / modulus["tip"])
        assert off(step, exact[:, None] * [1, 0, 0]) < 1e-10


def test_a_bracket_of_two_blocks():
    """A leg tied to a foot at 3:4, onto a larger surface, has the energy of a bracket of one mesh."""
    foot, leg, load = (0, 0, 0), (0, 0, 1), (1e-4, 0.0, 0.0)

    def blocks(n, m):
        return block(foot, (3, 1, 1), (3 * n, n, n), 1), block(leg, (1, 1, 3), (m, m, 2 * m), 1)

    def scene(mesh, **more):
        held = (Dirichlet(f"{mesh.bodies[0]} right" if more else "held", x=0.0, y=0.0, z=0.0),)
        pull = (Traction(f"{mesh.bodies[-1]} top" if more else "loaded", load),)
        return Scene("bracket", mesh, dict.fromkeys(mesh.bodies, MATERIAL), held, tractions=pull, **more)

    whole = join(*blocks(2, 2)).named("held", "right", where=lambda x: x[0] > 2.9)
    whole = whole.named("loaded", "top", where=lambda x: x[2] > 2.9)
    one = scene(root_mesh_from_shapes({"ell": whole}, {"held": "ell held", "loaded": "ell loaded"}))
    mesh = root_mesh_from_shapes(dict(zip(("foot", "leg"), blocks(3, 4))))
    tolerance, energies = 0.05, []
    for each in (one, scene(mesh, ties=(Tie("leg bottom", "foot top"),))):
        *_, step = adapt(each, tolerance, degree=2)
        assert step.record.reached and step.record.doubts == []
        energies.append(step.estimate.energy_norm)
    assert abs(energies[1] / energies[0] - 1) < tolerance**2


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("other, same", [(None, 1e-9), (3, 0.01)], ids=["alike", "2:3"])
@pytest.mark.parametrize("angle", [0, 30], ids=["along an axis", "oblique"])
def test_a_symmetry_plane_through_a_tie(degree, other, same, angle):
    """Half of a bar, bent in its plane of symmetry, has the energy and section force of the whole one."""
    cosine, sine = np.cos(np.radians(angle)), np.sin(np.radians(angle))

    def turned(low, parts):
        """Both parts from y = low to y = 1, turned about x."""
        blocks = [
            block((x, low, 0), (x + 2, 1, 1), (2 * n, round(n * (1 - low)), n), 1)
            for x, n in zip((0, 2), (2, 2 if other is None else other))
        ]
        place = lambda x: (x[0], cosine * x[1] - sine * x[2], sine * x[1] + cosine * x[2])  # noqa: E731
        return root_mesh_from_shapes({name: shape.placed(place) for name, shape in zip(parts, blocks)})

    load = tuple(np.array([0.0, -sine, cosine]) * 1e-4)
    full, half = (bar(turned(low, ("base", "tip")), TIED, load) for low in (-1, 0))
    planes = tuple(SymmetryPlane(f"{name} front") for name in ("base", "tip"))
    half = replace(half, dirichlet=(*half.dirichlet, *planes), symmetry=2)
    assert len(half.oblique_planes) == (2 if angle else 0)
    double, single = (next(adapt(scene, 0.9, degree=degree, solver=TIGHT)) for scene in (full, half))
    assert abs(single.estimate.energy_norm**2 * 2 / double.estimate.energy_norm**2 - 1) < same
    for step in (double, single):
        (force,) = of_kind(step, "tie").values()
        assert np.abs(force[:3] + 2 * np.array(load)).max() < 1e-8 * 1e-4


def test_rows_where_a_plane_of_symmetry_holds_a_component():
    """On meshes apart there are none of this component, and those of the two others."""
    planes = tuple(SymmetryPlane(f"{name} front") for name in ("base", "tip"))
    half = bar(cut(2, 3), TIED)
    half = replace(half, dirichlet=(*half.dirichlet, *planes), symmetry=2)
    rows = next(adapt(half, 0.9, degree=2)).solution.rows
    axes, on = gathered(WORLD, rows.normal).argmax(axis=1), np.abs(gathered(WORLD, rows.position)[:, 1]) < 1e-9
    assert [int((axes[on] == axis).sum()) for axis in range(3)] == [7, 0, 7]
    assert [int((axes == axis).sum()) for axis in range(3)] == [49, 42, 49]
    assert WORLD.allreduce(rows.yielded) == 7


def on_base(mesh, first, second, **more):
    """A block on a base, pressed by 0.01 in the mean, beside the middle, so that it lifts off on the left."""
    held = (Dirichlet("low bottom", x=0.0, y=0.0, z=0.0), Dirichlet("stamp top", x=0.0, y=0.0))
    return Scene(
        "stamp",
        mesh,
        dict.fromkeys(mesh.bodies, MATERIAL),
        held,
        (ContactPair(first, second),),
        (Pressure("stamp top", lambda x: 0.01 * (1 + 4 * (x[0] - 1))),),
        **more,
    )


def stamp(tied, n=4):
    """A block on a base of one mesh, or of two layers that are tied."""
    block_on_top = block((0.5, 0.5, 2), (1.5, 1.5, 3), (2, 2, 2), 1)

    def seat(x):
        return ((x[:2] > 0.49) & (x[:2] < 1.51)).all(axis=0) & (x[2] > 1.9)

    def layer(low, high, count):
        return block((0, 0, low), (2, 2, high), (count, count, count * (high - low) // 2), 1)

    if not tied:
        mesh = {"low": layer(0, 2, n).named("seat", "top", where=seat), "stamp": block_on_top}
        return on_base(root_mesh_from_shapes(mesh), "stamp bottom", "low seat")
    high = layer(1, 2, n).named("seat", "top", where=seat)
    mesh = {"low": layer(0, 1, n), "high": high, "stamp": block_on_top}
    ties = (Tie("low top", "high bottom"),)
    return on_base(root_mesh_from_shapes(mesh), "stamp bottom", "high seat", ties=ties)


@pytest.mark.parametrize("degree", [1, 2])
def test_ties_are_no_contact(degree, monkeypatch):
    """Figures of a contact above a tie are those without the tie: rows of ties do not press, open, or slide.

    Also if the interior-point method finds the closed rows.
    """
    one, two = (next(adapt(stamp(tied), 0.9, degree=degree, solver=TIGHT)) for tied in (False, True))
    record, names = two.record, ("force", "pair_forces", "max_pressure", "contact_centre", "pair_alignments")
    for name in names:
        assert np.allclose(getattr(one.record, name), getattr(record, name), rtol=1e-8), name
    closed = WORLD.allreduce(np.array([two.solution.active.sum(), (~two.solution.active).sum()]))
    assert one.record.active_pairs == record.active_pairs == closed[0] and (closed > 0).all()
    assert [doubt.kind for doubt in record.doubts] == [doubt.kind for doubt in one.record.doubts]
    assert len(record.pair_errors) == 1 and two.contact.names == ("stamp bottom on high seat",)
    (section,) = of_kind(two, "tie").values()
    assert np.abs(section[:3] - [0, 0, 0.01]).max() < 1e-10  # the lower layer holds the upper one
    monkeypatch.setattr(active_set, "_UPDATES", 1)
    again = next(adapt(stamp(True), 0.9, degree=degree, solver=TIGHT))
    assert again.record.contact_iterations > record.contact_iterations
    assert np.allclose(again.solution.displacement, two.solution.displacement, rtol=0, atol=1e-10)


@pytest.mark.parametrize("factor", [1.0, 100.0, 1e6])
def test_a_penalty(factor):
    """Tied surfaces part by p h / (c E*), with the size h of the facets."""
    scene = bar(cut(), TIED, (1e-3, 0.0, 0.0), materials=dict.fromkeys(("base", "tip"), Material(1.0, 0.0)))
    step = next(adapt(scene, 0.9, degree=1, solver=TIGHT, enforcement=Enforcement("penalty", factor=factor)))
    x, tip = positions(step)[:, 0], step.solution.displacement[:, 0]
    right = x > 3.9
    gap = 1e-3 * 0.5 / (factor * 0.5)
    everywhere(np.abs(tip[right] - 4e-3 - gap).max(initial=0.0) < 1e-9, "another gap")


@pytest.mark.parametrize("other", [None, 3], ids=["alike", "2:3"])
def test_goals(other):
    """Displacement and reaction of a tied bar meet their tolerances: those of one mesh that is much finer."""
    point, load = (4.0, 0.5, 0.5), (0.0, 0.0, 1e-4)
    goals = Displacement(point, (0, 0, 1), 0.02), Reaction("base left", 0.02, (0, 0, 1))
    *_, step = adapt(bar(cut(2, other), TIED, load), 0.05, degree=2, goals=goals)
    *_, fine = adapt(bar(whole(), (), load), 0.02, degree=2, goals=(Displacement(point, (0, 0, 1), 0.001),))
    moved, held = step.record.goals
    assert step.record.reached and moved.error is not None
    assert abs(moved.value / fine.record.goals[0].value - 1) < 0.02 and abs(held.value / -1e-4 - 1) < 1e-6


def test_what_a_tie_holds():
    """It resists all rigid motions of one body against the other, which the load drives without it."""
    assert next(adapt(bar(cut(), TIED), 0.9)).record.free_motions is None
    with pytest.raises(SolveError, match="nothing holds body 'tip' along y and along z and about z: a load"):
        next(adapt(bar(cut()), 0.9))


def test_a_scene_shows_its_ties():
    """In its repr, and in the fingerprint that a restart compares."""
    scene = bar(cut(), TIED)
    assert "ties: 'base right' tied to 'tip left'" in repr(scene)
    assert scene_parts(scene)["ties"] == [["Tie", "base right", "tip left"]]
    assert scene_parts(bar(whole()))["ties"] == []


@all_ranks
def test_a_tie_that_cannot_be_held():
    """Both sides of a node are prescribed, to different values."""
    mesh = cut()
    held = tuple(Dirichlet(f"{body} front", y=value) for body, value in (("base", 0.0), ("tip", 1e-3)))
    scene = bar(mesh, TIED)
    with pytest.raises(SolveError, match="both surfaces of a tie, or around it, differ by 0.001"):
        next(adapt(replace(scene, dirichlet=(*scene.dirichlet, *held)), 0.9, degree=1))


@pytest.mark.parametrize("distance, n, refused", [(0.1, 2, False), (0.2, 2, True), (0.2, 1, False), (-0.2, 2, True)])
@pytest.mark.parametrize("other", [0, 1], ids=["alike", "apart"])
def test_surfaces_apart(distance, n, refused, other):
    """The distance is limited by the diagonal of the facets, and stays."""
    parts = block((0, 0, 0), (2, 1, 1), (2 * n, n, n), 1)
    tip = block((2 + distance, 0, 0), (4, 1, 1), (2, n + other, n + other), 1)
    mesh = root_mesh_from_shapes({"base": parts, "tip": tip})
    if refused:
        with pytest.raises(SceneError, match=r"'base right' tied to 'tip left': the surfaces are 0.2 apart near \["):
            bar(mesh, TIED)
    else:
        step = next(adapt(bar(mesh, TIED, (1e-3, 0.0, 0.0)), 0.9, degree=1))
        assert abs(of_kind(step, "tie")["base right tied to tip left"][0] + 1e-3) < 1e-9
