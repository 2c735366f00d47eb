"""Hanging nodes and the prolongation P from conforming to all nodal unknowns.

A node of a fine leaf that is none of the nodes of a coarser leaf's edge or face on which it lies hangs there: its value
is that of the coarser leaf's function.  At degree 1 these are the middles of edges and faces, with the weights 1/2 and
1/4 (section 2 of the paper; J. Cerveny, V. Dobrev, T. Kolev, SIAM J. Sci. Comput. 41(4), 2019).  Masters that hang
themselves are replaced by theirs until none does.
"""

import numpy as np
import numpy.typing as npt
from dolfinx.la import InsertMode, vector
from scipy.sparse import csr_matrix, vstack

from fx_contact.fem.space import Space
from fx_contact.parallel.compat import index_map
from fx_contact.parallel.mpi import Directory
from fx_contact.problem import hexahedron
from fx_contact.problem.lattice import MAX_LEVEL

_NONE = -1


class Prolongation:
    """P: the values at all nodes of this rank's leaves from those at the conforming nodes.

    Collective on space.forest.comm.  What is carried may have any unit, which it keeps.

    Args:
        space: Space.
        needed: (k,) int64 keys of nodes of any rank whose values this rank needs, as rows of contact do; they may hang.

    Attributes:
        comm: MPI communicator.
        space: as given, with m nodes on this rank.
        hanging: (m,) bool, which of them hang.
        index_map: IndexMap of the conforming nodes: owned ones first, in the order in which the leaves touch them, then
            those of other ranks that this rank's nodes and the needed ones take their values from.  A rank that holds a
            facing pair of leaves owns their facing nodes, both of them.
        conforming: (m,) int32, position of each node in `index_map`, -1 where it hangs.
        matrix: (m, owned + ghosts) scipy CSR float64, P on this rank.
        hanging_global: number of hanging nodes on all ranks.
    """

    def __init__(self, space: Space, needed: npt.ArrayLike = ()) -> None:
        self.comm, self.space = space.forest.comm, space
        masters, shares = _masters(space)
        self.hanging = (masters != _NONE).any(axis=1)
        number, owner = space.directory.number(~self.hanging, *_claims(space))
        needed = np.unique(np.asarray(needed, dtype=np.int64))
        self._needed = needed[space.find(needed) < 0]
        slaves, keys, weights = _resolve(space, masters, shares, self._needed)

        foreign = (owner != self.comm.rank) | self.hanging
        self._away = np.unique(keys[space.find(keys) < 0])
        known = np.stack([number, owner.astype(np.int64)], axis=1)
        far, _ = space.directory.lookup(self._away, known, ~foreign)
        near = foreign & ~self.hanging
        ghosts = np.concatenate([number[near], far[:, 0]])
        owners = np.concatenate([owner[near], far[:, 1].astype(np.int32)])
        owned = int((~foreign).sum())
        self.index_map = index_map(self.comm, owned, ghosts, owners)
        self.conforming = np.full(len(space), -1, dtype=np.int32)
        self.conforming[~foreign] = np.arange(owned)
        self.conforming[near] = owned + np.arange(near.sum())

        columns = self.find(keys)
        own = np.flatnonzero(~self.hanging)
        entries = np.concatenate([np.ones(len(own)), weights])
        places = np.concatenate([own, slaves]), np.concatenate([self.conforming[own], columns])
        shape = len(space) + len(self._needed), owned + len(ghosts)
        matrix = csr_matrix((entries, places), shape=shape)
        self.matrix, self._of_needed = matrix[: len(space)], matrix[len(space) :]
        _, holder = space.directory.number(self.hanging)
        self.hanging_global = self.comm.allreduce(int((self.hanging & (holder == self.comm.rank)).sum()))

    def find(self, keys):
        """Positions in `index_map` of nodes, ghosts included, by their keys.  Local.

        Args:
            keys: (k,) int64 keys of nodes that this rank's leaves have or hang on, or that are needed.

        Returns:
            (k,) int64, -1 where a node hangs.
        """
        place = self.space.find(keys)
        here = place >= 0
        result = np.full(len(keys), -1, dtype=np.int64)
        result[here] = self.conforming[place[here]]
        away = np.flatnonzero(~here & np.isin(keys, self._away))
        size = self.index_map.size_local + self.index_map.num_ghosts
        result[away] = size - len(self._away) + np.searchsorted(self._away, keys[away])
        return result

    def rows(self, keys: npt.NDArray[np.int64]) -> csr_matrix:
        """P at nodes that this rank's leaves have or that are needed: (k, owned + ghosts).  Local."""
        place = self.space.find(keys)
        away = len(self.space) + np.searchsorted(self._needed, keys)
        return vstack([self.matrix, self._of_needed], format="csr")[np.where(place >= 0, place, away)]

    @property
    def owned(self):
        """Number of conforming nodes that this rank owns."""
        return self.index_map.size_local

    def zeros(self, k):
        """(owned + ghosts, k) float64 zeros, to put in what `summed` takes.  Local."""
        return np.zeros((self.index_map.size_local + self.index_map.num_ghosts, k))

    def injected(self, values):
        """Owned conforming values out of values at all nodes, R: R P = I.

        Local.

        Args:
            values: (m, ...) array.

        Returns:
            (owned, ...) array.
        """
        own = (self.conforming >= 0) & (self.conforming < self.owned)
        result = np.empty((self.owned, *values.shape[1:]), values.dtype)
        result[self.conforming[own]] = values[own]
        return result

    def prolong(self, values):
        """Values at all nodes from the owned conforming ones.

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
        """P^T of what this rank's cells contribute to their nodes, summed over the ranks.

        Collective on comm.

        Args:
            values: (m, k) float64, not summed over ranks.

        Returns:
            (owned, k) float64.
        """
        return self.summed(self.matrix.T @ values)

    def averaged(self, at, values):
        """Means over the ranks of what each says of conforming nodes, NaN where none says anything.

        Collective on comm.

        Args:
            at: (n,) int, distinct positions in `index_map`.
            values: (n, k) float64.

        Returns:
            (owned, k) float64.
        """
        sums = self.zeros(values.shape[1] + 1)
        sums[at] = np.column_stack([values, np.ones(len(at))])
        sums = self.summed(sums)
        with np.errstate(invalid="ignore"):
            return sums[:, :-1] / sums[:, -1:]

    def summed(self, values):
        """Sums over the ranks of what each says of conforming nodes.

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


def _masters(space):
    """What each node hangs on, of this rank or others.

    Collective on space.forest.comm.

    Returns:
        (m, (p+1)^2) int64 keys of the masters, -1 where there are fewer or none, and their float64 weights.
    """
    masters = np.full((len(space), (space.degree + 1) ** 2), _NONE, dtype=np.int64)
    weights = np.zeros(masters.shape)
    for dimension, entities, nodes in (
        (1, space.forest.edges, space.edge_nodes),
        (2, space.forest.faces, space.face_nodes),
    ):
        points, shares = _hanging_points(space.degree, dimension)
        directory, example = _points_on(space, entities, nodes, points)
        asked = np.flatnonzero(directory.asked(space.keys))
        leaf, which, point = example[asked].T
        rows = np.column_stack([space.keys[space.cells[leaf[:, None], nodes[which]]], point])
        rows, found = Directory(space.forest.comm, directory.keys[asked], space.forest.homes.of_points).lookup(
            space.keys, rows, np.ones(len(asked), dtype=bool)
        )
        share = shares[rows[found, -1]]
        masters[found, : nodes.shape[1]] = np.where(share != 0, rows[found, :-1], _NONE)
        weights[found, : nodes.shape[1]] = share
    return masters, weights


def _hanging_points(degree, dimension):
    """Points inside an edge or a face that are nodes of its halves or quarters, but none of its own.

    Returns:
        (h, dimension) int64 coordinates in 1..2p-1, last axis first; (h, (p+1)^dimension) float64 weights of the nodes.
    """
    steps = np.indices((2 * degree - 1,) * dimension).reshape(dimension, -1).T + 1
    steps = steps[(steps % 2 == 1).any(axis=1)]
    functions = hexahedron.lagrange(degree, steps / (2 * degree))  # (h, dimension, p + 1)
    weights = functions[:, 0]
    for axis in range(1, dimension):
        weights = (weights[:, :, None] * functions[:, axis, None]).reshape(len(steps), -1)
    return steps, weights


def _points_on(space, entities, nodes, points):
    """The Directory of such points of edges or faces, and of each (leaf, local entity, point): (k, 3) int64."""
    if space.degree == 1:  # the one point is the middle, by which the entity is named
        return entities.directory, np.column_stack(
            [entities.example, np.zeros(len(entities.example), dtype=np.int64)]
        )
    forest = space.forest
    coarse = entities.example[forest.level[entities.example[:, 0]] < MAX_LEVEL]
    leaf, which = coarse.T
    corners = space.points[leaf[:, None], nodes[which][:, [0, space.degree, -1 - space.degree]]].astype(np.int64)
    origin, ends = corners[:, :1], (corners[:, 2:], corners[:, 1:2])[-points.shape[1] :]
    place = origin + sum((end - origin) * along[:, None] // (2 * space.degree) for end, along in zip(ends, points.T))
    keys = forest.lattice.keys(forest.cell[leaf], place.astype(np.int32))
    example = np.column_stack([np.repeat(coarse, len(points), axis=0), np.tile(np.arange(len(points)), len(coarse))])
    return Directory(forest.comm, keys.ravel(), forest.homes.of_points), example


def _claims(space: Space) -> tuple[npt.NDArray[np.int8], npt.NDArray[np.int64]]:
    """For the ownership of each node its claim and ballot.

    A node on a contact surface is owned by a rank that holds a contact face of it; facing nodes are drawn alike.
    """
    forest = space.forest
    claim, ballot = np.zeros(len(space), dtype=np.int8), space.keys.copy()
    claim[space.on_faces(*forest.contact_faces())] = 1
    leaf, face = forest.paired_faces()
    second = forest.contact_surfaces.side[forest.cell[leaf], face] == 1
    leaf, face = leaf[second], face[second]
    ballot[space.on_faces(leaf, face)] = space.facing(leaf, face)
    return claim, ballot


def _resolve(
    space: Space, masters: npt.NDArray[np.int64], weights: npt.NDArray[np.float64], needed: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """Slave positions, master keys and weights, none of the masters hanging; needed nodes follow this rank's."""
    hanging = np.flatnonzero((masters != _NONE).any(axis=1))
    rows = np.column_stack([masters, weights.view(np.int64)])
    slaves, keys, shares = _expand(hanging, rows[hanging], np.ones(len(hanging)))
    slaves = np.concatenate([slaves, len(space) + np.arange(len(needed))])
    keys, shares = np.concatenate([keys, needed]), np.concatenate([shares, np.ones(len(needed))])
    done = []
    while space.directory.comm.allreduce(len(keys)):
        place = space.find(keys)
        above = rows[np.maximum(place, 0)] if len(rows) else np.full((len(keys), rows.shape[1]), _NONE)
        away = place < 0
        above[away], _ = space.directory.lookup(keys[away], rows, np.ones(len(rows), dtype=bool))
        chained = (above[:, : masters.shape[1]] != _NONE).any(axis=1)
        done.append((slaves[~chained], keys[~chained], shares[~chained]))
        slaves, keys, shares = _expand(slaves[chained], above[chained], shares[chained])
    if not done:
        return slaves, keys, shares
    slaves, keys, shares = (np.concatenate(column) for column in zip(*done))
    return slaves, keys, shares


def _expand(slaves, rows, shares):
    """One row for each master of each slave; rows hold keys and, as bits, the weights of the masters."""
    masters, weights = np.split(rows, 2, axis=1)
    valid, weights = masters != _NONE, weights.view(np.float64)
    return np.repeat(slaves, valid.sum(axis=1)), masters[valid], (shares[:, None] * weights)[valid]
