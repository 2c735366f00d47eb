"""How far strains move surfaces towards each other: rigid motions do not count."""

from types import SimpleNamespace

import numpy as np
import pytest
from conftest import WORLD, everywhere

from fx_contact import ContactPair, Dirichlet, Material, Pressure, Scene, adapt
from fx_contact.estimate.contact_goals import moved_by_strains
from fx_contact.scenes import punch, stack
from studies.boxes import BACK, DOWN, FRONT, LEFT, RIGHT, UP, Boxes
from studies.stability.shapes import beam

pytestmark = pytest.mark.whole_run

STIFF = Material(1e3, 0.3)
LONG = 10.0


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


def test_what_closed_contact_stops_is_no_rigid_motion():
    """The beam's bending brings the rider to the stop, whose area is four times that of its seat."""
    step = next(iter(adapt(rider(), 0.3)))
    pairs, moved = step.pairs, moved_by_strains(step)
    over, whole = gathered(pairs.contact) == 1, gathered(step.solution.penetration + pairs.gap)
    assert np.allclose(gathered(moved)[over], whole[over], rtol=0.1) and whole[over].min() > 5e-3
