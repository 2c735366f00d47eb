"""Open places that strains may close: what counts as moved by strains, and what as a place."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import WORLD, everywhere

from fx_contact import ContactPair, Dirichlet, Material, Pressure, Scene, adapt
from fx_contact.contact.contact_patches import ContactPatches
from fx_contact.estimate.candidate_contact import CandidateZones, moved_by_strains
from fx_contact.estimate.contact_energy import PressureClusters
from fx_contact.estimate.dual_weighted import Goals
from fx_contact.estimate.error_control import ErrorControl
from fx_contact.scenes import punch, stack
from fx_contact.scenes.boxes import BACK, DOWN, FRONT, LEFT, RIGHT, UP, Boxes
from studies.stability.shapes import beam

pytestmark = pytest.mark.whole_run

STIFF = Material(1e3, 0.3)
LONG = 10.0


def strips(gaps):
    """A clamped plate that bends towards another body, two strips of each in contact, with gaps of their own."""
    boxes = Boxes(1)
    boxes.add("plate", (0.0, 0.0, 0.0), (LONG, 3.0, 1.0), (5, 3, 1))
    boxes.add("base", (0.0, 0.0, -1.0), (LONG, 3.0, 0.0), (5, 3, 1))
    tips, heads = boxes.facets(DOWN, 0.0, "plate"), boxes.facets(UP, 0.0, "base")
    surfaces = {name: some[some[:, 0] // 5 % 3 != 1] for name, some in (("tips", tips), ("heads", heads))}
    surfaces |= {"wall": boxes.facets(LEFT, 0.0, "plate"), "foot": boxes.facets(DOWN, -1.0, "base")}
    surfaces |= {"load": boxes.facets(UP, 1.0, "plate")}

    def place(name, x):
        gap = np.where(x[:, 1] > 1.5, gaps[1], gaps[0])
        return x - np.outer(gap * (0.5 + 0.5 * x[:, 0] / LONG) * (name == "base"), [0, 0, 1])

    return Scene(
        "strips",
        boxes.mesh(surfaces, place=place),
        dict.fromkeys(("plate", "base"), Material(1.0, 0.0)),
        (Dirichlet("wall", 0.0, 0.0, 0.0), Dirichlet("foot", 0.0, 0.0, 0.0)),
        (ContactPair("tips", "heads", direction=(0, 0, -1)),),
        (Pressure("load", 1e-6),),
    )


def rider():
    """A block that may move along z alone stands on a beam's tip, which bends, and hangs over a wide stop."""
    boxes = Boxes(1)
    boxes.add("beam", (0.0, 0.0, -1.0), (LONG, 1.0, 0.0), (10, 1, 1))
    boxes.add("rider", (9.0, 0.0, 0.0), (14.0, 1.0, 1.0), (5, 1, 1))
    boxes.add("stop", (10.0, 0.0, -1.0), (14.0, 1.0, 0.0), (4, 1, 1))
    below, above = boxes.facets(DOWN, 0.0, "rider"), boxes.facets(UP, 0.0, "beam")
    surfaces = {"wall": boxes.facets(LEFT, 0.0, "beam"), "foot": boxes.facets(DOWN, -1.0, "stop")}
    surfaces |= {"seat": below[:1], "arm": below[1:], "tip": above[-1:], "head": boxes.facets(UP, 0.0, "stop")}
    sides = {"left": (LEFT, 9.0), "right": (RIGHT, 14.0), "front": (FRONT, 0.0), "back": (BACK, 1.0)}
    surfaces |= {name: boxes.facets(face, level, "rider") for name, (face, level) in sides.items()}
    surfaces |= {"load": boxes.facets(UP, 1.0, "rider")}
    held = [Dirichlet(name, 0.0, 0.0, 0.0) for name in ("wall", "foot")]
    return Scene(
        "rider",
        boxes.mesh(surfaces, place=lambda name, x: x - np.outer(np.full(len(x), 0.1 * (name == "stop")), [0, 0, 1])),
        dict.fromkeys(("beam", "rider", "stop"), Material(1.0, 0.0)),
        (*held, *(Dirichlet(name, 0.0, 0.0) for name in sides)),
        (ContactPair("tip", "seat", direction=(0, 0, 1)), ContactPair("arm", "head", direction=(0, 0, -1))),
        (Pressure("load", 1e-6),),
    )


def gathered(values):
    """The values of all ranks, one after the other."""
    return np.concatenate(WORLD.allgather(values))


def places_of(step):
    """The open places of the only contact pair: (k, n) weights on all ranks, and the pairs around closed contact."""
    patches = ContactPatches(step.forest, step.pairs, step.solution.active)
    clusters = PressureClusters(step.pairs, step.solution.force, patches.pair, patches.number)
    around = clusters.around(step.pairs, np.full(patches.number, True))
    zones = CandidateZones(step, patches, clusters, ErrorControl())
    return gathered(zones.places(0).T).T, gathered(around)


@pytest.mark.parametrize("load", [{"displacement": 1.01}, {"force": 2e-3}])
def test_rigid_motions_are_no_strains(load):
    """However far bodies come, and whether a condition brings them or a force, strains move them by no more."""
    near, far = (
        next(iter(adapt(punch(gap=gap, block=Material(1.0, 0.3), punch=STIFF, **values), 0.2, degree=1)))
        for gap, values in ((0.0, load | ({"displacement": 0.01} if "displacement" in load else {})), (1.0, load))
    )
    here, there = (moved_by_strains(step) for step in (near, far))
    here, there = (np.sort(gathered(moved)) for moved in (here, there))
    assert np.allclose(here, there, atol=1e-7) and 1e-4 < np.abs(there).max() < 0.02
    assert gathered(far.solution.penetration + far.pairs.gap).min() > 0.95


def test_rigid_motions_of_all_ranks():
    """Closed contact on one rank alone shows how far a body has come, and what is open on others has come as far."""
    x, y = (axis.ravel() for axis in np.meshgrid([0.0, 0.5, 1.0], [0.0, 1.0]))
    pairs = SimpleNamespace(
        position=np.stack([x, y, 0 * x + 1], axis=1),
        normal=np.tile([0.0, 0.0, 1.0], (6, 1)),
        bodies=np.tile([0, 1], (6, 1)),
        gap=0.1 + x,
        area=np.ones(6),
        prolongation=SimpleNamespace(comm=WORLD),
    )
    closed = np.full(6, WORLD.rank == WORLD.size - 1)
    solution = SimpleNamespace(penetration=0.2 - pairs.gap, active=closed)
    scene = stack(pressure=0.01, gap=0.1, cells=(1, 1, 1))
    moved = moved_by_strains(SimpleNamespace(scene=scene, pairs=pairs, solution=solution))
    everywhere(np.abs(moved).max() < 1e-12, "a rigid motion is left")


def test_strains_that_bend_a_clamped_body_stay():
    """A beam is moved by all that it bends; a block that turns on its foot by no more than its faces are not flat."""
    bent, turned = (next(iter(adapt(beam(1.5, near=1e-3, afar=afar), 0.3, degree=1))) for afar in (0.0, 0.5))
    here, there = (moved_by_strains(step) for step in (bent, turned))
    whole, all_of_it = (gathered(step.solution.penetration + step.pairs.gap) for step in (bent, turned))
    assert np.array_equal(gathered(here), whole)
    assert np.abs(np.sort(gathered(there)) - np.sort(whole)).max() < 0.05 * whole.max() < 0.01 * all_of_it.max()


def test_places():
    """A place has open nodes of two bodies, those for which strains have done most, and of parts that are alike."""
    for number, near, touch in ((1, None, 0.0), (2, 1e-3, 0.0), (2, None, 2e-6)):
        scene = beam(0.85 if touch else 0.95, tension=3e-3, near=near, touch=touch)
        *_, step = adapt(scene, 0.3, degree=1, max_steps=2)
        weights, _ = places_of(step)
        assert len(weights) == number and np.allclose(weights.sum(axis=1), 1)
        assert (weights >= 0).all() and ((weights > 0).sum(axis=0) <= 1).all()
        assert not weights[:, gathered(step.solution.active)].any()
        left, gap = gathered(-step.solution.penetration), gathered(step.pairs.gap)
        for weight in weights:
            assert 0 < left[weight > 0].min() and left[weight > 0].max() < gap.max() / 3
        beside = gathered(step.pairs.position)[:, 1] > 2
        assert beside.any() == (touch > 0) and not weights[:, beside].any()


def test_what_is_around_contact_is_no_place():
    """Round bodies have gaps next to closed contact that are as small as strains move them, on any mesh."""
    *_, step = adapt(punch(), 0.15)
    weights, around = places_of(step)
    closed = gathered(step.solution.active)
    assert len(weights) == 0 and around[closed].all() and closed.sum() < around.sum() < len(around)


def test_unlike_strips_are_places_of_their_own():
    """One that has all but closed does not hide another one of the same bodies, which has more to go."""
    step = next(iter(adapt(strips((0.02, 0.2)), 0.3)))
    weights, _ = places_of(step)
    y = gathered(step.pairs.position)[:, 1]
    assert not gathered(step.solution.active).any()
    assert {bool(y[weight > 0].min() > 1.5) for weight in weights} == {False, True}
    assert all(np.ptp(y[weight > 0]) <= 1 for weight in weights)
    # Where vertices are to the last digit decides nothing: those of halved cells are not on the bounds of parts.
    for salt in range(3):
        off = 1e-12 * np.random.default_rng(salt + 3 * WORLD.rank).uniform(-1, 1, (len(step.pairs), 3))
        parts = {name: getattr(step, name) for name in ("scene", "forest", "solution")}
        moved = SimpleNamespace(pairs=replace(step.pairs, position=step.pairs.position + off), **parts)
        again, _ = places_of(moved)
        assert again.shape == weights.shape and ((again > 0) == (weights > 0)).all()


def test_what_closed_contact_stops_is_no_rigid_motion():
    """The beam's bending brings the rider to the stop, whose area is four times that of its seat."""
    step = next(iter(adapt(rider(), 0.3)))
    pairs, moved = step.pairs, moved_by_strains(step)
    over, whole = gathered(pairs.contact) == 1, gathered(step.solution.penetration + pairs.gap)
    assert np.allclose(gathered(moved)[over], whole[over], rtol=0.1) and whole[over].min() > 5e-3


@pytest.mark.parametrize("touch", [0.0, 2e-8])
def test_a_mesh_that_locks_tells_nothing(touch, monkeypatch):
    """Cells of degree 1, ten times as long as high, hardly bend: a gap before them is not known to stay open."""
    asked, gap = [], Goals.gap
    monkeypatch.setattr(Goals, "gap", lambda goals, weight: asked.append(gap(goals, weight)) or asked[-1])
    scene = beam(0.7, touch=touch, tension=0.1, thick=0.1)
    *_, step = adapt(scene, 0.3, degree=1, max_steps=2)
    goal, record = asked[0], step.record
    assert (
        goal.dual.relative > ErrorControl.dual_limit
        and goal.moved < 0.2 * goal.value
        and goal.total < 0.25 * goal.value
    )
    assert record.pair_leaves[0] > 0 and record.pair_errors[0] >= 1 and not record.reached
