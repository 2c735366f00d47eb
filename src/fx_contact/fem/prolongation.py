"""Hanging nodes and the prolongation P from conforming to all nodal unknowns.

A node of a fine leaf on an edge or face of a coarser leaf, but none of its nodes, hangs there: its value is that of the
coarser leaf's function (section 2 of the paper; J. Cerveny, V. Dobrev, T. Kolev, SIAM J. Sci. Comput. 41(4), 2019).
Masters that hang themselves are replaced by theirs.
"""

from typing import TypeVar

import numpy as np
import numpy.typing as npt
from dolfinx.la import InsertMode, Vector, vector
from scipy.sparse import csr_matrix, vstack

from fx_contact.fem.space import Space
from fx_contact.forest.lattice_points import LatticePoints
from fx_contact.geometry import hexahedron
from fx_contact.geometry.lattice import MAX_LEVEL
from fx_contact.parallel.arrays import FloatArray, Int8Array, Int32Array, Int64Array, IntArray
from fx_contact.parallel.compat import index_map
from fx_contact.parallel.mpi import Directory, any_true

_NONE = -1

_Scalar = TypeVar("_Scalar", bound=np.generic)


class Prolongation:
    """P: the values at all nodes of this rank's leaves from those at the conforming nodes.

    Collective on space.forest.comm.

    Args:
        space: with m nodes on this rank.
        needed: (k,), keys of further nodes of any rank, for rows of contact; they may hang.

    Attributes:
        hanging: (m,), True at hanging nodes.
        index_map: of the conforming nodes: owned ones first, in the order of `Space.keys`, then the masters of this
            rank's and of needed nodes on other ranks.
        conforming: (m,) int32, position of each node in `index_map`, -1 where it hangs.
        matrix: (m, owned + ghosts), P on this rank.
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
        self._vectors: dict[int, Vector] = {}
        _, holder = space.directory.number(self.hanging)
        self.hanging_global = self.comm.allreduce(int((self.hanging & (holder == self.comm.rank)).sum()))

    def reaching(self, keys: Int64Array) -> "Prolongation":
        """This, or one with further nodes by their keys (k,), the same at those of this rank.  Collective on comm."""
        away = (self.space.find(keys) < 0) & ~np.isin(keys, self._needed)
        if not any_true(self.comm, away):
            return self
        return Prolongation(self.space, np.concatenate([self._needed, keys[away]]))

    def find(self, keys: Int64Array) -> Int64Array:
        """Positions (k,) in `index_map`, -1 where a node hangs, by keys (k,) of nodes or masters.  Local."""
        place = self.space.find(keys)
        here = place >= 0
        result = np.full(len(keys), -1, dtype=np.int64)
        result[here] = self.conforming[place[here]]
        away = np.flatnonzero(~here & np.isin(keys, self._away))
        size = self.index_map.size_local + self.index_map.num_ghosts
        result[away] = size - len(self._away) + np.searchsorted(self._away, keys[away])
        return result

    def rows(self, keys: Int64Array) -> csr_matrix:
        """P at nodes of this rank's leaves and needed ones by their keys (k,): (k, owned + ghosts).  Local."""
        place = self.space.find(keys)
        away = len(self.space) + np.searchsorted(self._needed, keys)
        return vstack([self.matrix, self._of_needed], format="csr")[np.where(place >= 0, place, away)]

    @property
    def keys(self) -> Int64Array:
        """(owned + ghosts,), lattice keys of the conforming nodes.  Local."""
        size = self.index_map.size_local + self.index_map.num_ghosts
        keys: Int64Array = np.empty(size, dtype=np.int64)
        keys[self.conforming[~self.hanging]] = self.space.keys[~self.hanging]
        keys[size - len(self._away) :] = self._away
        return keys

    @property
    def numbers(self) -> Int32Array:
        """(owned + ghosts,), global numbers of the conforming nodes.  Local."""
        size = self.index_map.size_local + self.index_map.num_ghosts
        numbers: Int32Array = self.index_map.local_to_global(np.arange(size, dtype=np.int32)).astype(np.int32)
        return numbers

    @property
    def owned(self) -> int:
        """Number of conforming nodes that this rank owns."""
        return self.index_map.size_local

    def zeros(self, k: int) -> FloatArray:
        """(owned + ghosts, k) zeros, for `summed`.  Local."""
        return np.zeros((self.index_map.size_local + self.index_map.num_ghosts, k))

    def injected(self, values: npt.NDArray[_Scalar]) -> npt.NDArray[_Scalar]:
        """Owned conforming values (owned, ...) of values (m, ...) at all nodes, R with R P = I.  Local."""
        return values[(self.conforming >= 0) & (self.conforming < self.owned)]

    def prolong(self, values: FloatArray) -> FloatArray:
        """P: values (m, k) at all nodes from the owned conforming ones (owned, k).  Collective on comm."""
        return self.matrix @ self.ghosted(values)

    def ghosted(self, values: FloatArray) -> FloatArray:
        """Owned conforming values (owned, k), with those of the ghosts: (owned + ghosts, k).  Collective on comm."""
        if self.comm.size == 1:
            return values.copy()
        spread = self._vector(values.shape[1])
        spread.array[: values.size] = values.ravel()
        spread.scatter_forward()
        return spread.array.reshape(-1, values.shape[1]).copy()

    def restrict(self, values: FloatArray) -> FloatArray:
        """P^T: (owned, k), of contributions (m, k) of each rank's cells to their nodes.  Collective on comm."""
        return self.summed(self.matrix.T @ values)

    def averaged(self, at: IntArray, values: FloatArray) -> FloatArray:
        """Means (owned, k) over the ranks of values (n, k) at distinct positions (n,) in `index_map`, NaN without any.

        Collective on comm.
        """
        sums = self.sums_at(at, np.column_stack([values, np.ones(len(at))]))
        with np.errstate(invalid="ignore"):
            return sums[:, :-1] / sums[:, -1:]

    def summed(self, values: FloatArray) -> FloatArray:
        """Sums (owned, k) over the ranks of values (owned + ghosts, k) at conforming nodes, on one rank the values.

        Collective on comm.
        """
        if self.comm.size == 1:
            return values
        gathered = self._vector(values.shape[1])
        gathered.array[:] = values.ravel()
        gathered.scatter_reverse(InsertMode.add)
        return gathered.array[: self.owned * values.shape[1]].reshape(self.owned, values.shape[1]).copy()

    def sums_at(self, at: IntArray, values: FloatArray) -> FloatArray:
        """Sums (owned, k) over the ranks of values (n, ..., k) at positions (n, ...) in `index_map`.

        Collective on comm.
        """
        sums = self.zeros(values.shape[-1])
        np.add.at(sums, at, values)
        return self.summed(sums)

    def _vector(self, k: int) -> Vector:
        """A vector of k components a node, made once: its two communicators cost more than its messages."""
        if k not in self._vectors:
            self._vectors[k] = vector(self.index_map, k)
        return self._vectors[k]


def _masters(space: Space) -> tuple[Int64Array, FloatArray]:
    """Keys (m, (p+1)^2) of the masters of each node on any rank, -1 where there are fewer, and their weights."""
    masters = np.full((len(space), (space.degree + 1) ** 2), _NONE, dtype=np.int64)
    weights = np.zeros(masters.shape)
    edges, faces = (space.forest.edges, space.edge_nodes), (space.forest.faces, space.face_nodes)
    for dimension, (entities, nodes) in enumerate((edges, faces), 1):
        points, shares = _hanging_points(space.degree, dimension)
        directory, example = _points_on(space, entities, nodes, points)
        asked = np.flatnonzero(directory.asked(space.keys))
        leaf, which, point = example[asked].T
        rows = np.column_stack([space.keys[space.cells[leaf[:, None], nodes[which]]], point])
        known = Directory(space.forest.comm, directory.keys[asked], space.forest.homes.of_points)
        rows, found = known.lookup(space.keys, rows, np.ones(len(asked), dtype=bool))
        share = shares[rows[found, -1]]
        masters[found, : nodes.shape[1]] = np.where(share != 0, rows[found, :-1], _NONE)
        weights[found, : nodes.shape[1]] = share
    return masters, weights


def _hanging_points(degree: int, dimension: int) -> tuple[Int64Array, FloatArray]:
    """Nodes of the halves or quarters of an edge or a face that hang on it, and their weights (h, (p+1)^dimension).

    Coordinates (h, dimension) are in 1..2p-1, last axis first.
    """
    steps = np.indices((2 * degree - 1,) * dimension).reshape(dimension, -1).T + 1
    steps = steps[(steps % 2 == 1).any(axis=1)]
    functions = hexahedron.lagrange(degree, steps / (2 * degree))  # (h, dimension, p + 1)
    weights = functions[:, 0]
    for axis in range(1, dimension):
        weights = (weights[:, :, None] * functions[:, axis, None]).reshape(len(steps), -1)
    return steps, weights


def _points_on(
    space: Space, entities: LatticePoints, nodes: Int64Array, points: Int64Array
) -> tuple[Directory, Int64Array]:
    """Directory of such points of edges or faces, and of each (leaf, local entity, point): (k, 3)."""
    if space.degree == 1:  # the one point is the middle, by which the entity is named
        middle = np.zeros(len(entities.example), dtype=np.int64)
        return entities.directory, np.column_stack([entities.example, middle])
    forest = space.forest
    coarse = entities.example[forest.level[entities.example[:, 0]] < MAX_LEVEL]
    leaf, which = coarse.T
    corners = space.points[leaf[:, None], nodes[which][:, [0, space.degree, -1 - space.degree]]].astype(np.int64)
    origin, ends = corners[:, :1], (corners[:, 2:], corners[:, 1:2])[-points.shape[1] :]
    place = np.repeat(origin, len(points), axis=1)
    for axis, end in enumerate(ends):
        place += (end - origin) * points[:, axis, None] // (2 * space.degree)
    keys = forest.lattice.keys(forest.cell[leaf], place.astype(np.int32))
    example = np.column_stack([np.repeat(coarse, len(points), axis=0), np.tile(np.arange(len(points)), len(coarse))])
    return Directory(forest.comm, keys.ravel(), forest.homes.of_points), example


def _claims(space: Space) -> tuple[Int8Array, Int64Array]:
    """Claim and ballot of each node for its ownership.

    The owner of a node on a contact surface holds a contact face of it; facing nodes are drawn alike.
    """
    forest = space.forest
    claim, ballot = np.zeros(len(space), dtype=np.int8), space.keys.copy()
    claim[space.on_faces(*forest.contact_faces())] = 1
    leaf, face = forest.paired_faces()
    second = forest.pairing.second[forest.cell[leaf], face]
    leaf, face = leaf[second], face[second]
    ballot[space.on_faces(leaf, face)] = space.facing(leaf, face)
    return claim, ballot


def _resolve(
    space: Space, masters: Int64Array, weights: FloatArray, needed: Int64Array
) -> tuple[Int64Array, Int64Array, FloatArray]:
    """Slave positions, master keys and weights, none of the masters hanging; needed nodes follow this rank's."""
    hanging = np.flatnonzero((masters != _NONE).any(axis=1))
    rows = np.column_stack([masters, weights.view(np.int64)])
    slaves, keys, shares = _expand(hanging, rows[hanging], np.ones(len(hanging)))
    slaves = np.concatenate([slaves, len(space) + np.arange(len(needed))])
    keys, shares = np.concatenate([keys, needed]), np.concatenate([shares, np.ones(len(needed))])
    done = [(slaves[:0], keys[:0], shares[:0])]
    while space.directory.comm.allreduce(len(keys)):
        place = space.find(keys)
        above = rows[np.maximum(place, 0)] if len(rows) else np.full((len(keys), rows.shape[1]), _NONE)
        away = place < 0
        above[away], _ = space.directory.lookup(keys[away], rows, np.ones(len(rows), dtype=bool))
        chained = (above[:, : masters.shape[1]] != _NONE).any(axis=1)
        done.append((slaves[~chained], keys[~chained], shares[~chained]))
        slaves, keys, shares = _expand(slaves[chained], above[chained], shares[chained])
    slaves, keys, shares = (np.concatenate(column) for column in zip(*done))
    return slaves, keys, shares


def _expand(slaves: Int64Array, rows: Int64Array, shares: FloatArray) -> tuple[Int64Array, Int64Array, FloatArray]:
    """One row for each master of each slave; rows hold keys and, as bits, the weights of the masters."""
    masters, weights = np.split(rows, 2, axis=1)
    valid, weights = masters != _NONE, weights.view(np.float64)
    return np.repeat(slaves, valid.sum(axis=1)), masters[valid], (shares[:, None] * weights)[valid]
