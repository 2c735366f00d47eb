"""Contact spots: what is connected of the closed contact, whichever contact pairs of the scene it belongs to."""

import numpy as np
from mpi4py import MPI
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from fx_contact._mpi import Directory
from fx_contact.contact import facets_of

_NONE = np.iinfo(np.int64).max


class Spots:
    """The spot of each vertex on a facet of the first contact surfaces that is closed at one of its vertices.

    Collective on forest.comm.

    Args:
        forest: Forest.
        pairs: NodePairs.
        active: (n,) bool, closed pairs.

    Attributes:
        number: int, of all ranks' spots.
        vertex: (m,) int64, the spot of each of this rank's vertices, -1 where there is none.
        pair: (n,) int64, the spot of each pair, -1 where its vertex has none.
    """

    def __init__(self, forest, pairs, active):
        vertices, prolongation = forest.vertices, pairs.prolongation
        facets = [facets_of(index, forest) for index in range(int(forest.pairing.pair.max()) + 1)]
        cells = np.concatenate([vertices.cells[leaf[:, None], corner] for leaf, _, corner in facets])
        touched = np.zeros((prolongation.index_map.size_local + prolongation.index_map.num_ghosts, 1))
        touched[pairs.first[active]] = 1
        closed = (prolongation.prolong(prolongation.summed(touched))[cells, 0] > 0).any(axis=1)

        here, position = np.unique(cells, return_inverse=True)
        keys, position = vertices.keys[here], position.reshape(-1, 4)
        label = _lowest_connected(Directory(forest.comm, keys), position[closed])
        known = label < _NONE
        spots = np.unique(np.concatenate(forest.comm.allgather(np.unique(label[known]))))
        self.number, self.vertex = len(spots), np.full(len(vertices), -1)
        self.vertex[here[known]] = np.searchsorted(spots, label[known])
        of_conforming, conform = np.full(len(touched), -1), prolongation.conforming >= 0
        of_conforming[prolongation.conforming[conform]] = self.vertex[conform]
        self.pair = of_conforming[pairs.first]


def _lowest_connected(directory, facets):
    """The lowest key among the vertices connected by facets: (n,) int64, `_NONE` for those of none.

    Collective on directory.comm.  Each turn carries the lowest key across a border between ranks.

    Args:
        directory: Directory of the (n,) vertices' keys.
        facets: (k, 4) int, this rank's facets, positions of their vertices there.
    """
    n, k = len(directory.keys), len(facets)
    rows, columns = np.repeat(np.arange(k), 4), k + facets.ravel()
    _, part = connected_components(
        csr_matrix((np.ones(4 * k), (rows, columns)), shape=(k + n, k + n)), directed=False
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
