"""Hanging vertices and the prolongation P from conforming to all vertex unknowns.

A vertex that is the midpoint of a leaf's edge, or the centre of a leaf's face, hangs there with weights 1/2 or 1/4
(section 2 of the paper; J. Cerveny, V. Dobrev, T. Kolev, SIAM J. Sci. Comput. 41(4), 2019).  Masters that hang
themselves are replaced by theirs until none does.
"""

import numpy as np
from dolfinx.la import InsertMode, vector
from scipy.sparse import csr_matrix

from fx_contact.parallel.compat import index_map
from fx_contact.parallel.mpi import Directory
from fx_contact.problem import hexahedron

_NONE = -1


class Prolongation:
    """P: the values of all vertices of this rank's leaves from those of the conforming vertices.

    Collective on forest.comm.

    Args:
        forest: Forest.

    Attributes:
        vertices: Vertices of the forest.
        hanging: (m,) bool, which of them hang.
        index_map: IndexMap of the conforming vertices: owned ones first, in the order in which the leaves touch
            them, then those of other ranks that this rank's vertices need.  A rank that holds a facing pair of leaves
            owns their facing vertices, both of them.
        conforming: (m,) int32, position of each vertex in `index_map`, -1 where it hangs.
        matrix: (m, owned + ghosts) scipy CSR float64, P on this rank.
        hanging_global: number of hanging vertices on all ranks.
    """

    def __init__(self, forest):
        self.comm = forest.comm
        self.vertices = vertices = forest.vertices
        masters = _masters(forest)
        self.hanging = masters[:, 0] != _NONE
        claim, ballot, facing = _claims(forest)
        number, owner = vertices.directory.number(~self.hanging, claim, ballot)
        slaves, keys, weights = _resolve(vertices, masters)

        foreign = (owner != self.comm.rank) | self.hanging
        needed = np.concatenate([keys, facing])
        away = np.unique(needed[vertices.find(needed) < 0])
        far, conform = vertices.directory.lookup(away, np.stack([number, owner.astype(np.int64)], axis=1), ~foreign)
        self._away, far = away[conform], far[conform]  # of the facing vertices some hang
        near = foreign & ~self.hanging
        ghosts = np.concatenate([number[near], far[:, 0]])
        owners = np.concatenate([owner[near], far[:, 1].astype(np.int32)])
        owned = int((~foreign).sum())
        self.index_map = index_map(self.comm, owned, ghosts, owners)
        self.conforming = np.full(len(vertices), -1, dtype=np.int32)
        self.conforming[~foreign] = np.arange(owned)
        self.conforming[near] = owned + np.arange(near.sum())

        columns = self.find(keys)
        own = np.flatnonzero(~self.hanging)
        entries = np.concatenate([np.ones(len(own)), weights])
        places = np.concatenate([own, slaves]), np.concatenate([self.conforming[own], columns])
        self.matrix = csr_matrix((entries, places), shape=(len(vertices), owned + len(ghosts)))
        counted, holder = vertices.directory.number(self.hanging)
        self.hanging_global = self.comm.allreduce(int((self.hanging & (holder == self.comm.rank)).sum()))

    def find(self, keys):
        """Positions in `index_map` of vertices, ghosts included, by their keys.  Local.

        Args:
            keys: (m,) int64 keys of vertices that this rank's leaves have, hang on, or face.

        Returns:
            (m,) int64, -1 where a vertex hangs.
        """
        place = self.vertices.find(keys)
        here = place >= 0
        result = np.full(len(keys), -1, dtype=np.int64)
        result[here] = self.conforming[place[here]]
        away = np.flatnonzero(~here & np.isin(keys, self._away))
        size = self.index_map.size_local + self.index_map.num_ghosts
        result[away] = size - len(self._away) + np.searchsorted(self._away, keys[away])
        return result

    @property
    def owned(self):
        """Number of conforming vertices that this rank owns."""
        return self.index_map.size_local

    def prolong(self, values):
        """All vertex values from the owned conforming ones.

        Collective on comm.

        Args:
            values: (owned, k) float64.

        Returns:
            (m, k) float64.
        """
        return self.matrix @ self.ghosted(values)

    def ghosted(self, values):
        """Owned conforming values and those of the ghosts.  Collective on comm.

        Args:
            values: (owned, k) float64.

        Returns:
            (owned + ghosts, k) float64.
        """
        k = values.shape[1]
        spread = vector(self.index_map, k)
        spread.array[: values.size] = values.ravel()
        spread.scatter_forward()
        return spread.array.reshape(-1, k)

    def restrict(self, values):
        """P^T of what this rank's cells contribute to their vertices, summed over the ranks.

        Collective on comm.

        Args:
            values: (m, k) float64, not summed over ranks.

        Returns:
            (owned, k) float64.
        """
        return self.summed(self.matrix.T @ values)

    def summed(self, values):
        """Sums over the ranks of what each says of conforming vertices.

        Collective on comm.

        Args:
            values: (owned + ghosts, k) float64, in the order of `index_map`.

        Returns:
            (owned, k) float64.
        """
        k = values.shape[1]
        gathered = vector(self.index_map, k)
        gathered.array[:] = values.ravel()
        gathered.scatter_reverse(InsertMode.add)
        return gathered.array[: self.owned * k].reshape(-1, k).copy()


def _masters(forest):
    """Keys of the two or four vertices that each vertex hangs on, padded with -1; all -1 where it does not: (m, 4)."""
    wanted = forest.vertices.keys
    result = np.full((len(wanted), 4), _NONE, dtype=np.int64)
    for entities, corners in ((forest.edges, hexahedron.EDGE_CORNERS), (forest.faces, hexahedron.FACE_CORNERS)):
        asked = np.flatnonzero(entities.directory.asked(wanted))
        leaf, which = entities.example[asked].T
        ends = forest.vertices.keys[forest.vertices.cells[leaf[:, None], corners[which]]]
        rows, found = Directory(forest.comm, entities.directory.keys[asked]).lookup(
            wanted, ends, np.ones(len(asked), dtype=bool)
        )
        result[found, : rows.shape[1]] = rows[found]
    return result


def _claims(forest):
    """For the ownership of each vertex its claim and ballot, and the keys of the vertices that face this rank's.

    Facing vertices are drawn alike, among the ranks that hold a contact face of each.
    """
    vertices = forest.vertices
    claim, ballot = np.zeros(len(vertices), dtype=np.int8), vertices.keys.copy()
    leaf, face = forest.contact_faces()
    corner = hexahedron.FACE_CORNERS[face]
    mine = vertices.cells[leaf[:, None], corner]
    cell, _, points = forest.pairing.opposite(forest.cell[leaf], face, forest.corners[leaf[:, None], corner])
    facing = forest.lattice.keys(cell, points)
    claim[mine] = 1
    second = ~forest.pairing.first[forest.cell[leaf], face]
    ballot[mine[second]] = facing[second]
    return claim, ballot, facing[~second].ravel()


def _resolve(vertices, masters):
    """Slave positions, master keys and weights, none of the masters hanging."""
    hanging = np.flatnonzero(masters[:, 0] != _NONE)
    slaves, keys, weights = _expand(hanging, masters[hanging], np.ones(len(hanging)))
    done = []
    while vertices.directory.comm.allreduce(len(keys)):
        place = vertices.find(keys)
        above = masters[np.maximum(place, 0)] if len(masters) else np.full((len(keys), 4), _NONE)
        away = place < 0
        above[away], _ = vertices.directory.lookup(keys[away], masters, np.ones(len(masters), dtype=bool))
        chained = above[:, 0] != _NONE
        done.append((slaves[~chained], keys[~chained], weights[~chained]))
        slaves, keys, weights = _expand(slaves[chained], above[chained], weights[chained])
    if not done:
        return slaves, keys, weights
    return (np.concatenate(column) for column in zip(*done))


def _expand(slaves, masters, weights):
    """One row for each master of each slave."""
    valid = masters != _NONE
    count = valid.sum(axis=1)
    return np.repeat(slaves, count), masters[valid], np.repeat(weights / np.maximum(count, 1), count)
