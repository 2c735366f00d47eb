"""Distinct vertices, edge midpoints, face centres or nodes of the leaves, by their lattice keys."""

import numpy as np
from mpi4py import MPI

from fx_contact.forest.homes import Homes
from fx_contact.parallel.arrays import Int32Array, Int64Array
from fx_contact.parallel.mpi import Directory


class LatticePoints:
    """Distinct lattice points of this rank's leaves, in the order of the leaves.

    Collective on comm.  By the lattice keys (n, k) of k points of each leaf.

    Attributes:
        keys: (m,), lattice keys, of which there is a `directory`.
        cells: (n, k), position of each leaf's points in `keys`.
        example: (m, 2), the first leaf that has the point, and the point's number in that leaf.
    """

    def __init__(self, comm: MPI.Intracomm, found: Int64Array, homes: Homes) -> None:
        k = found.shape[1]
        keys, index, cells = np.unique(found, return_index=True, return_inverse=True)
        order = np.argsort(index, kind="stable")
        self._ascending = np.argsort(order)
        self.keys: Int64Array = keys[order]
        self.cells: Int32Array = self._ascending[cells].reshape(-1, k).astype(np.int32)
        self.example: Int64Array = np.stack(np.divmod(index[order], k), axis=1)
        self.directory = Directory(comm, self.keys, homes.of_points)

    def __len__(self) -> int:
        return len(self.keys)

    def find(self, keys: Int64Array) -> Int64Array:
        """Positions (...) of keys (...) among this rank's points, -1 where absent.  Local."""
        if not len(self):
            return np.full(np.shape(keys), -1, dtype=np.int64)
        slot = np.searchsorted(self.keys, keys, sorter=self._ascending)
        place = self._ascending[np.minimum(slot, len(self) - 1)]
        return np.where(self.keys[place] == keys, place, -1)
