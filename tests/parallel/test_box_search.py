"""Overlapping boxes of all ranks."""

import numpy as np
import pytest
from conftest import WORLD, everywhere

from fx_contact.parallel.box_search import Boxes, meeting_boxes

pytestmark = pytest.mark.ranks(1, 2, 3)


def boxes(seed, count, smallest):
    """Boxes of random sizes from `smallest` to 1, flat ones among them, about the origin."""
    random = np.random.default_rng(seed)
    size = smallest ** random.random((count, 1)) * random.choice([0.0, 0.3, 1.0], (count, 3))
    low = 2 * random.random((count, 3)) - 1
    return low, low + size


@pytest.mark.parametrize("smallest", [1.0, 1e-3])
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_every_meeting_boxes_pair_is_found_once(smallest, scale):
    """As by comparing all boxes with all."""
    low, high = (scale * corner for corner in boxes(1, 300, smallest))
    asked_low, asked_high = (scale * corner for corner in boxes(2, 200, smallest))
    mine, ours = np.arange(300) % WORLD.size == WORLD.rank, np.flatnonzero(np.arange(200) % WORLD.size == WORLD.rank)
    queries, of_all = Boxes(asked_low[ours], asked_high[ours]), Boxes(low[mine], high[mine])
    query, name = meeting_boxes(WORLD, queries, of_all, np.flatnonzero(mine)[:, None])
    meet = (asked_low[:, None] <= high) & (asked_high[:, None] >= low)
    expected = np.argwhere(meet.all(axis=2))
    assert len(expected) > 50
    found = np.stack([ours[query], name[:, 0]], axis=1)
    expected = expected[np.isin(expected[:, 0], ours)]
    everywhere(np.array_equal(found[np.lexsort(found.T[::-1])], expected), "other pairs")
    everywhere((np.diff(query) >= 0).all(), "not in order")


def test_ranks_without_boxes():
    """Boxes on the last rank, queries on the first; points are boxes."""
    last, first = WORLD.rank == WORLD.size - 1, WORLD.rank == 0
    point, none = np.array([[0.5, -2.0, 3.0]]), np.zeros((0, 3))
    here, asked = (Boxes(at, at) for at in (point if last else none, point if first else none))
    query, name = meeting_boxes(WORLD, asked, here, np.full((len(here), 2), 7))
    everywhere(query.tolist() == [0] * first and name.tolist() == [[7, 7]] * first, f"{query} {name}")
    query, name = meeting_boxes(WORLD, Boxes(point, point), Boxes(none, none), np.zeros((0, 1), dtype=np.int64))
    everywhere(len(query) == len(name) == 0, "of no boxes")
