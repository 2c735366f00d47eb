"""Home ranks of keys, where the values registered for a key meet (`parallel.mpi.Directory`): near the leaves.

The home of a lattice point is the rank whose piece of the space-filling curve contains it, by the cuts of the last
partition, which all ranks know.  So a rank communicates with its neighbours only.
"""

from functools import lru_cache

import numpy as np

from fx_contact.forest.space_filling_curve import RootCurve
from fx_contact.geometry.lattice import Lattice, part_faces
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.parallel.arrays import Int32Array, Int64Array, IntArray
from fx_contact.parallel.mpi import hashed
from fx_contact.surfaces.facet_pairing import Pairing, decode_leaf


class Places:
    """Root cells of lattice points: the lowest with a paired facet there, else the lowest; facing points share it.

    Local.
    """

    def __init__(self, lattice: Lattice, pairing: Pairing) -> None:
        self._lattice, self._pairing = lattice, pairing
        paired = pairing.paired
        touching = np.any(paired[:, None] & part_faces(), axis=2)  # (ncells, 27)
        self._entities = lattice.entities(prefer=touching)
        _, cell, part = self._entities
        on = paired[cell] & part_faces()[part]
        self._face = np.where(on.any(axis=1), on.argmax(axis=1), -1)  # a paired facet of each entity

    def of(self, keys: Int64Array) -> tuple[Int64Array, Int32Array]:
        """Root cells (n,) and lattice coordinates (n, 3) of keys (n,).  Local."""
        cell, points, face = self._first(keys)
        facing = np.flatnonzero(face >= 0)
        if len(facing):
            neighbour, _, across = self._pairing.opposite(cell[facing], face[facing], points[facing, None])
            there = self._lattice.keys(neighbour, across)[:, 0]
            other, points_there, _ = self._first(there)
            lower = (other < cell[facing]) | (other == cell[facing]) & (there < keys[facing])
            cell[facing[lower]], points[facing[lower]] = other[lower], points_there[lower]
        return cell, points

    def _first(self, keys: Int64Array) -> tuple[Int64Array, Int32Array, Int64Array]:
        """Cells (n,), coordinates (n, 3), and the paired facets (n,) there on which the points lie, -1 if none."""
        entity, points = self._lattice.located(keys, self._entities)
        return self._entities[1][entity], points, self._face[entity]


#: The forests of a run have one root mesh.
_places, _curve = lru_cache(maxsize=1)(Places), lru_cache(maxsize=1)(RootCurve)


class Homes:
    """Homes of the lattice points and leaves of a forest: parts, the ranks of a run.

    Local.  By the cuts (parts - 1,) of the curve; None: by a hash.
    """

    def __init__(
        self, mesh: RootMesh, lattice: Lattice, pairing: Pairing, cuts: Int64Array | None, parts: int
    ) -> None:
        self._cuts, self._parts = cuts, parts
        if cuts is not None:
            self._places, self._curve = _places(lattice, pairing), _curve(mesh)

    def of_points(self, keys: Int64Array) -> Int32Array:
        """Homes (n,) of lattice points with keys (n,); the same for two points that face only each other.  Local."""
        if self._cuts is None:
            return hashed(keys, self._parts)
        return self._on_curve(self._cuts, *self._places.of(keys))

    def of_leaves(self, codes: Int64Array) -> Int32Array:
        """Homes (n,) of leaves with codes (n,) (`facet_pairing.leaf_code`).  Local."""
        if self._cuts is None:
            return hashed(codes, self._parts)
        cell, anchor = decode_leaf(codes)
        return self._on_curve(self._cuts, cell, anchor + 1)

    def _on_curve(self, cuts: Int64Array, cell: IntArray, points: Int32Array) -> Int32Array:
        """Parts (n,) that contain the finest leaf whose high corner is the point (n, 3).

        Of the eight leaves at a point this one gives the fewest partners, up to 41 at 8192 parts (studies/partition).
        """
        keys = self._curve.keys(cell, np.maximum(points - 1, 0))
        return np.searchsorted(cuts, keys, side="right").astype(np.int32)
