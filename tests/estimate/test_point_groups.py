"""Groups of points that are spread over the ranks."""

import numpy as np
from conftest import WORLD

from fx_contact.estimate.point_groups import bounding_boxes, distinct_rows, sums_by_row


def test_bounding_boxes():
    """Of points dealt out to the ranks; a group of one point has no extent, and none is 0."""
    points = np.array([[0.0, 0, 0], [1, 5, 2], [-3, 1, 1], [7, 7, 7]])
    mine = np.arange(4) % WORLD.size == WORLD.rank
    low, length = bounding_boxes(WORLD, points[mine], np.array([0, 0, 0, 1])[mine], 2)
    assert np.array_equal(low, [[-3, 0, 0], [7, 7, 7]]) and length[0] == 5 and 0 < length[1] < 1e-300


def test_rows():
    """Distinct rows are in ascending order on all ranks, and so are the sums of equal ones."""
    rows = np.array([[2, 1], [0, 3], [2, 1]]) + [0, WORLD.rank]
    every = sorted({tuple(row + [0, rank]) for rank in range(WORLD.size) for row in np.array([[2, 1], [0, 3]])})
    distinct, which = distinct_rows(WORLD, rows)
    assert distinct.tolist() == [list(row) for row in every] and np.array_equal(distinct[which], rows)
    summed, sums = sums_by_row(WORLD, rows, np.ones((3, 1)))
    assert np.array_equal(summed, distinct)
    assert np.array_equal(sums[:, 0], [2 if row[0] else 1 for row in every])
