"""Distinct vertices, edge midpoints, face centres or nodes of the leaves, by their lattice keys."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fx_contact.parallel.arrays import Int32Array, Int64Array
from fx_contact.parallel.mpi import Directory

if TYPE_CHECKING:
    from fx_contact.forest.forest import Forest


class LatticePoints:
    """Distinct lattice points of this rank's leaves, in the order of the leaves.

    Collective on forest.comm.  Of k points (n, k, 3) of each leaf, in lattice coordinates.

    Attributes:
        keys: (m,), lattice keys, of which there is a `directory`.
        cells: (n, k), position of each leaf's points in `keys`.
        example: (m, 2), the first leaf that has the point, and the point's number in that leaf.
    """

    def __init__(self, forest: Forest, points: Int32Array) -> None:
        k = points.shape[1]
        found = forest.lattice.keys(forest.cell, points)
        keys, index, cells = np.unique(found, return_index=True, return_inverse=True)
        order = np.argsort(index, kind="stable")
        self._ascending = np.argsort(order)
        self.keys: Int64Array = keys[order]
        self.cells: Int32Array = self._ascending[cells].reshape(-1, k).astype(np.int32)
        self.example: Int64Array = np.stack(np.divmod(index[order], k), axis=1)
        self.directory = Directory(forest.comm, self.keys, forest.homes.of_points)

    def __len__(self) -> int:
        return len(self.keys)

    def find(self, keys: Int64Array) -> Int64Array:
        """Positions (...) of keys (...) among this rank's points, -1 where absent.  Local."""
        if not len(self):
            return np.full(np.shape(keys), -1, dtype=np.int64)
        slot = np.searchsorted(self.keys, keys, sorter=self._ascending)
        place = self._ascending[np.minimum(slot, len(self) - 1)]
        return np.where(self.keys[place] == keys, place, -1)
