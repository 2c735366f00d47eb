"""Space-filling curves: through a cube and a root mesh, and the partition of a distributed weighted curve."""

import numpy as np
from mpi4py import MPI

from fx_contact.geometry import hexahedron
from fx_contact.geometry.lattice import MAX_LEVEL
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.parallel.arrays import Int64Array, IntArray


def hilbert(points: IntArray, bits: int) -> Int64Array:
    """Positions (n,), below 2^(3 bits), of integer points (n, 3), below 2^bits, along the Hilbert curve of a cube.

    Local.  At most 21 bits.  J. Skilling, "Programming the Hilbert curve", AIP Conf. Proc. 707 (2004).
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


def _spread(x: Int64Array) -> Int64Array:
    """Two zero bits between the bits of integers below 2^21."""
    masks = 0x1F00000000FFFF, 0x1F0000FF0000FF, 0x100F00F00F00F00F, 0x10C30C30C30C30C3, 0x1249249249249249
    for shift, mask in zip((32, 16, 8, 4, 2), masks):
        x = (x | x << shift) & mask
    return x


class RootCurve:
    """Hilbert keys of points in root cells: a curve of the cell centres, and one inside each cell.

    Local.  The curve inside a root cell runs in local axes aligned with the global ones as closely as possible.
    """

    def __init__(self, mesh: RootMesh) -> None:
        corners = mesh.points[mesh.corners]
        centres = corners.mean(axis=1)
        low = centres.min(axis=0)
        extent = max(np.ptp(centres, axis=0).max(), np.finfo(float).tiny)
        scaled = np.minimum((centres - low) / extent * (1 << 20), (1 << 20) - 1).astype(np.int64)
        self._position = np.empty(len(centres), dtype=np.int64)
        self._position[np.argsort(hilbert(scaled, 20), kind="stable")] = np.arange(len(centres))

        slope = np.einsum("va,nvg->nga", 2.0 * hexahedron.CORNERS - 1, corners)
        slope /= np.linalg.norm(slope, axis=1)[:, None]
        permutations = np.array([[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]])
        alignment = np.abs(slope[:, np.arange(3), permutations]).sum(axis=2)
        self._axis = permutations[alignment.argmax(axis=1)]
        self._flip = np.take_along_axis(slope, self._axis[:, :, None], axis=2)[:, :, 0] < 0

    def keys(self, cell: IntArray, anchor: IntArray) -> Int64Array:
        """Keys (n,) of leaves by root cells (n,) and low corners (n, 3), or of the finest leaves at points.  Local."""
        local = np.take_along_axis(anchor >> 1, self._axis[cell], axis=1)
        # The reflection of an anchor is the far corner of the reflected leaf, and lies in that leaf.
        local = np.where(self._flip[cell], (1 << MAX_LEVEL) - 1 - local, local)
        return self._position[cell] << 3 * MAX_LEVEL | hilbert(local, MAX_LEVEL)


def cut_curve(comm: MPI.Intracomm, keys: Int64Array, weights: Int64Array, parts: int) -> Int64Array:
    """Cuts of a weighted curve into parts of nearly equal weight; equal keys stay together.

    Collective on comm.  Bisection for all cuts at once: each round is one reduction of the weights below all distinct
    thresholds, few at first.  A cut is found once its bounds enclose one key: a weight below twice the lightest one.
    Each rank has a share of the keys (n,), non-negative, in any order, with positive weights (n,).

    Returns:
        (parts - 1,), ascending: part p holds the keys k with cuts[p-1] <= k < cuts[p].
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


def _below(comm: MPI.Intracomm, keys: Int64Array, weight_below: Int64Array, thresholds: Int64Array) -> Int64Array:
    """Weights (n,) of the keys of all ranks below each threshold (n,).  Collective on comm."""
    total = weight_below[np.searchsorted(keys, thresholds)]
    comm.Allreduce(MPI.IN_PLACE, total, op=MPI.SUM)
    return total
