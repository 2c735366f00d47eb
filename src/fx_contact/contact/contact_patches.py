"""Contact spots: what is connected of the closed contact of a contact pair of the scene."""

import numpy as np
from mpi4py import MPI
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from fx_contact.contact.node_pairs import facets_of
from fx_contact.parallel.mpi import Directory

_NONE = np.iinfo(np.int64).max


class Spots:
    """The spots that facets of the first contact surfaces are in: those closed at a vertex, and those next to them.

    Collective on forest.comm.  Closed facets of two contact pairs are in two spots, also where they share a vertex.

    Args:
        forest: Forest.
        pairs: NodePairs.
        active: (n,) bool, closed pairs.

    Attributes:
        number: int, of all ranks' spots.
        facet: for each contact pair of the scene (k,) int64, the spot of each facet that `facets_of` has, -1 where it
            is next to none.
        pair: (n,) int64, the spot of each pair, -1 where its facets are open.
        contact: (number,) int64, the contact pair of each spot.
    """

    def __init__(self, forest, pairs, active):
        self.number, self.facet, self.pair = 0, [], np.full(len(pairs), -1)
        self.contact = np.empty(0, dtype=np.int64)
        for index in range(int(forest.pairing.pair.max()) + 1):
            self._add(index, forest, pairs, active & (pairs.contact == index))

    def _add(self, index, forest, pairs, active):
        """The spots of one contact pair, whose closed pairs are given."""
        prolongation, space = pairs.prolongation, pairs.prolongation.space
        cells = space.on_faces(*facets_of(index, forest))
        touched = np.zeros((prolongation.index_map.size_local + prolongation.index_map.num_ghosts, 1))
        touched[pairs.first[active]] = 1
        closed = (prolongation.prolong(prolongation.summed(touched))[cells, 0] > 0).any(axis=1)

        here, position = np.unique(cells, return_inverse=True)
        label = _lowest_connected(Directory(forest.comm, space.keys[here]), position.reshape(cells.shape)[closed])
        known = label < _NONE
        spots = np.unique(np.concatenate(forest.comm.allgather(np.unique(label[known]))))
        spot = np.full(len(space), -1)
        spot[here[known]] = self.number + np.searchsorted(spots, label[known])
        self.facet.append(spot[cells].max(axis=1))

        of_conforming, conform = np.full(len(touched), -1), prolongation.conforming >= 0
        of_conforming[prolongation.conforming[conform]] = spot[conform]
        ours = pairs.contact == index
        self.pair[ours] = of_conforming[pairs.first[ours]]
        self.number += len(spots)
        self.contact = np.append(self.contact, np.full(len(spots), index))


def _lowest_connected(directory, facets):
    """The lowest key among the vertices connected by facets: (n,) int64, `_NONE` for those of none.

    Collective on directory.comm.  Each turn carries the lowest key across a border between ranks.

    Args:
        directory: Directory of the (n,) vertices' keys.
        facets: (k, j) int, this rank's facets, positions of their nodes there.
    """
    n, k = len(directory.keys), len(facets)
    rows, columns = np.repeat(np.arange(k), facets.shape[1]), k + facets.ravel()
    _, part = connected_components(
        csr_matrix((np.ones(facets.size), (rows, columns)), shape=(k + n, k + n)), directed=False
    )
    part, touched = part[k:], np.unique(facets)
    label = np.full(n, _NONE)
    label[touched] = directory.keys[touched]
    while True:
        lowest = np.full(n + k, _NONE)
        np.minimum.at(lowest, part[touched], label[touched])
        before, label = label, label.copy()
        label[touched] = lowest[part[touched]]
        label = directory.lowest(label)
        if not directory.comm.allreduce(bool((label != before).any()), op=MPI.LOR):
            return label
