"""Open places that strains may close: what counts as moved by strains, and what as a place."""

import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import WORLD

from fx_contact import Material, adapt
from fx_contact.openings import moved_by_strains, openings
from fx_contact.places import Places
from fx_contact.scenes import punch
from fx_contact.spots import Spots

sys.path.insert(0, str(Path(__file__).parents[1] / "demos"))

from stability_shapes import beam  # noqa: E402

STIFF = Material(1e3, 0.3)


def gathered(values):
    """The values of all ranks, one after the other."""
    return np.concatenate(WORLD.allgather(values))


def places_of(step):
    """The open places of the only contact pair: (k, n) weights on all ranks, and the pairs around closed contact."""
    pairs, contact = step.pairs, step.contact
    spots = Spots(step.forest, pairs, contact.active)
    places = Places(pairs, contact.force, spots.pair, spots.number)
    around = places.around(pairs, np.full(spots.number, True))
    moved, presses = moved_by_strains(step.scene, pairs, contact), bool(spots.number)
    surface = Spots(step.forest, pairs, np.ones(len(pairs), dtype=bool)).pair
    return gathered(openings(0, pairs, contact, moved, surface, around, presses).T).T, gathered(around)


@pytest.mark.parametrize("load", [{"displacement": 1.01}, {"force": 2e-3}])
def test_rigid_motions_are_no_strains(load):
    """However far bodies come, and whether a condition brings them or a force, strains move them by no more."""
    near, far = (
        next(iter(adapt(punch(gap=gap, block=Material(1.0, 0.3), punch=STIFF, **values), 0.2)))
        for gap, values in ((0.0, load | ({"displacement": 0.01} if "displacement" in load else {})), (1.0, load))
    )
    here, there = (moved_by_strains(step.scene, step.pairs, step.contact) for step in (near, far))
    here, there = (np.sort(gathered(moved)) for moved in (here, there))
    assert np.allclose(here, there, atol=1e-7) and 1e-4 < np.abs(there).max() < 0.02
    assert gathered(far.contact.penetration + far.pairs.gap).min() > 0.95


def test_strains_that_bend_a_clamped_body_stay():
    """A beam is moved by all that it bends; a block that turns on its foot by no more than its faces are not flat."""
    bent, turned = (next(iter(adapt(beam(1.5, near=1e-3, afar=afar), 0.3))) for afar in (0.0, 0.5))
    here, there = (moved_by_strains(step.scene, step.pairs, step.contact) for step in (bent, turned))
    whole, all_of_it = (gathered(step.contact.penetration + step.pairs.gap) for step in (bent, turned))
    assert np.array_equal(gathered(here), whole)
    assert np.abs(np.sort(gathered(there)) - np.sort(whole)).max() < 0.05 * whole.max() < 0.01 * all_of_it.max()


def test_places():
    """A place has open nodes of two bodies, those for which strains have done most, and of parts that are alike."""
    for number, near, touch in ((1, None, 0.0), (2, 1e-3, 0.0), (2, None, 2e-6)):
        *_, step = adapt(beam(0.85 if touch else 0.95, tension=3e-3, near=near, touch=touch), 0.3, max_steps=2)
        weights, _ = places_of(step)
        assert len(weights) == number and np.allclose(weights.sum(axis=1), 1)
        assert (weights >= 0).all() and ((weights > 0).sum(axis=0) <= 1).all()
        assert not weights[:, gathered(step.contact.active)].any()
        left, gap = gathered(-step.contact.penetration), gathered(step.pairs.gap)
        for weight in weights:
            assert 0 < left[weight > 0].min() and left[weight > 0].max() < gap.max() / 3
        beside = gathered(step.pairs.position)[:, 1] > 2
        assert beside.any() == (touch > 0) and not weights[:, beside].any()


def test_what_is_around_contact_is_no_place():
    """Round bodies have gaps next to closed contact that are as small as strains move them, on any mesh."""
    *_, step = adapt(punch(), 0.15)
    weights, around = places_of(step)
    closed = gathered(step.contact.active)
    assert len(weights) == 0 and around[closed].all() and closed.sum() < around.sum() < len(around)
