"""Groups of points that are spread over the ranks: their bounding boxes, and rows of integers that name them."""

import numpy as np
from mpi4py import MPI


def bounding_boxes(comm, position, group, count):
    """The boxes around groups of points, along the axes.

    Collective on comm.

    Args:
        comm: MPI communicator.
        position: (n, 3) float64, this rank's points, in any unit of length.
        group: (n,) int, the group of each.
        count: number of groups on all ranks.

    Returns:
        (count, 3) float64, lowest corners, and (count,) float64, longest sides, at least the smallest number above 0:
        in the unit of the points, alike on all ranks.
    """
    ends = np.full((2, count, 3), np.inf)
    np.minimum.at(ends, (0, group), position)
    np.minimum.at(ends, (1, group), -position)
    comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MIN)
    return ends[0], np.maximum((-ends[1] - ends[0]).max(axis=1), np.finfo(float).tiny)


def distinct_rows(comm, rows):
    """The distinct rows of all ranks, in ascending order, and which of them each row of this rank is.

    Collective on comm.

    Args:
        comm: MPI communicator.
        rows: (n, k) int, this rank's.

    Returns:
        (m, k) int, alike on all ranks, and (n,) int64, positions in these.
    """
    distinct = np.unique(np.concatenate(comm.allgather(np.unique(rows, axis=0))), axis=0)
    _, which = np.unique(np.concatenate([distinct, rows]), axis=0, return_inverse=True)
    return distinct, which.ravel()[len(distinct) :]


def sums_by_row(comm, rows, values):
    """The distinct rows of all ranks, in ascending order, and the sums of the values of equal ones.

    Collective on comm.

    Args:
        comm: MPI communicator.
        rows: (n, k) int, this rank's.
        values: (n, l) float64, of each.

    Returns:
        (m, k) int and (m, l) float64, in the unit of the values, alike on all ranks.
    """
    own = _added(rows, values)
    return _added(*map(np.concatenate, zip(*comm.allgather(own))))


def _added(rows, values):
    rows, which = np.unique(rows, axis=0, return_inverse=True)
    sums = np.zeros((len(rows), values.shape[1]))
    np.add.at(sums, which.ravel(), values)
    return rows, sums
