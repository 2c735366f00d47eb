"""Space-filling curves: Hilbert keys, and cutting a weighted curve that is spread over the ranks."""

import numpy as np
from mpi4py import MPI


def hilbert(points, bits):
    """Position of integer points along the Hilbert curve of a cube.

    Local.  J. Skilling, "Programming the Hilbert curve", AIP Conf. Proc. 707 (2004).

    Args:
        points: (n, 3) int in 0..2^bits - 1.
        bits: levels of the curve, at most 21.

    Returns:
        (n,) int64 in 0..2^(3 bits) - 1; neighbours on the curve are neighbours in space.
    """
    x = [np.ascontiguousarray(column, dtype=np.int64) for column in points.T]
    bit = 1 << bits - 1
    while bit > 1:
        below = bit - 1
        for axis in range(3):
            inverted = (x[axis] & bit) != 0
            mixed = (x[0] ^ x[axis]) & below
            x[0] = x[0] ^ np.where(inverted, below, mixed)
            x[axis] = x[axis] ^ np.where(inverted | (axis == 0), 0, mixed)
        bit >>= 1
    x[1] ^= x[0]
    x[2] ^= x[1]
    twist = np.zeros_like(x[0])
    bit = 1 << bits - 1
    while bit > 1:
        twist ^= np.where((x[2] & bit) != 0, bit - 1, 0)
        bit >>= 1
    return _spread(x[0] ^ twist) << 2 | _spread(x[1] ^ twist) << 1 | _spread(x[2] ^ twist)


def _spread(x):
    """Put two zero bits between the bits of integers below 2^21."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        x = (x | x << shift) & mask
    return x


def cut_curve(comm, keys, weights, parts):
    """Cut a weighted curve into parts of nearly equal weight; equal keys are never cut apart.

    Collective on comm.  A bisection for all cuts at once, in which no rank receives another rank's keys: each round is
    one reduction of the weights under all thresholds, of which many cuts share one at first.  A cut is found once less
    than twice the lightest weight is between its bounds, which is one key's: for 8192 parts of a million leaves these
    are nine numbers a part, not one a part for each bit of the keys (studies/partition).

    Args:
        comm: MPI communicator.
        keys: (n,) int64 non-negative, this rank's share of the curve in any order.
        weights: (n,) int64 positive.
        parts: number of parts.

    Returns:
        (parts - 1,) int64 ascending: part p holds the keys k with cuts[p-1] <= k < cuts[p].
    """
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    weight_below = np.concatenate([[0], np.cumsum(weights[order])]).astype(np.int64)
    last = comm.allreduce(int(keys[-1]) if len(keys) else 0, op=MPI.MAX)
    total = comm.allreduce(int(weight_below[-1]))
    lightest = comm.allreduce(int(weights.min(initial=total)), op=MPI.MIN)
    target = total * np.arange(1, parts) / parts
    low, high = np.zeros(parts - 1, dtype=np.int64), np.full(parts - 1, last + 1, dtype=np.int64)
    weight_low, weight_high = np.zeros(parts - 1, dtype=np.int64), np.full(parts - 1, total, dtype=np.int64)
    while len(cut := np.flatnonzero((high - low > 1) & (weight_high - weight_low >= 2 * lightest))):
        thresholds, which = np.unique(low[cut] + (high[cut] - low[cut]) // 2, return_inverse=True)
        middle, weight = thresholds[which], _below(comm, keys, weight_below, thresholds)[which]
        enough = weight >= target[cut]
        low[cut[~enough]], weight_low[cut[~enough]] = middle[~enough], weight[~enough]
        high[cut[enough]], weight_high[cut[enough]] = middle[enough], weight[enough]
    return np.where(target - weight_low < weight_high - target, low, high)


def _below(comm, keys, weight_below, thresholds):
    """Weight of all keys under each threshold, over all ranks: (n,) int64.  Collective on comm."""
    total = weight_below[np.searchsorted(keys, thresholds)]
    comm.Allreduce(MPI.IN_PLACE, total, op=MPI.SUM)
    return total
