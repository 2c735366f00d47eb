"""Contact patches: the connected parts of the closed contact of each contact pair."""

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from fx_contact.contact.contact_facets import facets_of
from fx_contact.parallel.components import lowest_labels
from fx_contact.parallel.mpi import Directory

_NONE = np.iinfo(np.int64).max


class ContactPatches:
    """Facets of the first contact surfaces that are closed at a node, connected by their nodes, and those next to them.

    Collective on forest.comm.  Closed facets of two contact pairs are in two patches, also where they share a node.

    Args:
        forest: Forest.
        pairs: NodePairs.
        active: (n,) bool, closed pairs.

    Attributes:
        number: number of patches on all ranks.
        facet: for each contact pair of the scene (k,) int64, the patch of each facet that `facets_of` has, -1 where it
            is next to none.
        pair: (n,) int64, the patch of each node pair, -1 where its facets are open.
        contact: (number,) int64, the contact pair of each patch.
    """

    def __init__(self, forest, pairs, active):
        self.number, self.facet, self.pair = 0, [], np.full(len(pairs), -1)
        self.contact = np.empty(0, dtype=np.int64)
        for index in range(int(forest.pairing.pair.max()) + 1):
            self._add(index, forest, pairs, active & (pairs.contact == index))

    def _add(self, index, forest, pairs, active):
        """The patches of one contact pair, whose closed pairs are given."""
        prolongation, space = pairs.prolongation, pairs.prolongation.space
        cells = space.on_faces(*facets_of(index, forest))
        touched = prolongation.zeros(1)
        touched[pairs.first[active]] = 1
        closed = (prolongation.prolong(prolongation.summed(touched))[cells, 0] > 0).any(axis=1)

        here, position = np.unique(cells, return_inverse=True)
        directory = Directory(forest.comm, space.keys[here], forest.homes.of_points)
        label = _lowest_connected(directory, position.reshape(cells.shape)[closed])
        known = label < _NONE
        patches = np.unique(np.concatenate(forest.comm.allgather(np.unique(label[known]))))
        patch = np.full(len(space), -1)
        patch[here[known]] = self.number + np.searchsorted(patches, label[known])
        self.facet.append(patch[cells].max(axis=1))

        of_conforming, conform = np.full(len(touched), -1), prolongation.conforming >= 0
        of_conforming[prolongation.conforming[conform]] = patch[conform]
        ours = pairs.contact == index
        self.pair[ours] = of_conforming[pairs.first[ours]]
        self.number += len(patches)
        self.contact = np.append(self.contact, np.full(len(patches), index))


def _lowest_connected(directory, facets):
    """The lowest key among the nodes connected by facets: (n,) int64, `_NONE` for those of none.

    Collective on directory.comm.

    Args:
        directory: Directory of the (n,) nodes' keys.
        facets: (k, j) int, this rank's facets, positions of their nodes there.
    """
    n, k = len(directory.keys), len(facets)
    rows, columns = np.repeat(np.arange(k), facets.shape[1]), k + facets.ravel()
    graph = csr_matrix((np.ones(facets.size), (rows, columns)), shape=(k + n, k + n))
    _, part = connected_components(graph, directed=False)
    key = np.full(n, _NONE)
    key[facets] = directory.keys[facets]
    return lowest_labels(directory.comm, part[k:], key, directory.lowest)
