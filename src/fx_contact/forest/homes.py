"""Homes of keys: the ranks on which facts about a key are brought together, near the leaves that have it.

The home of a lattice point is the rank whose piece of the space-filling curve holds it, as the last partition along the
curve has cut it: the key names a root entity and integer coordinates there, a root cell of that entity gives the place
on the curve, and the cuts, which all ranks know, the rank.  So a rank exchanges facts with its neighbours alone,
however many ranks there are.  Refinement moves leaves away from home, not far.
"""

from functools import lru_cache

import numpy as np

from fx_contact.forest.root_curve import RootCurve
from fx_contact.parallel.mpi import hashed
from fx_contact.problem.facet_pairing import decode_leaf
from fx_contact.problem.lattice import part_faces


class Homes:
    """The homes of the keys of a forest.  Local.

    Args:
        forest: Forest.
        cuts: (parts - 1,) int64, cuts of its curve, ascending; None: a hash gives the homes.
        parts: number of parts: of ranks in a run, any in a study.
    """

    def __init__(self, forest, cuts, parts):
        self._cuts, self._parts = cuts, parts
        if cuts is not None:
            self._places, self._curve = _of_roots(forest.mesh, forest.lattice, forest.pairing)

    def of_points(self, keys):
        """Home of each lattice point; two points that face each other have one, unless they face others too.

        Local.

        Args:
            keys: (n,) int64, lattice keys.

        Returns:
            (n,) int32 parts.
        """
        if self._cuts is None:
            return hashed(keys, self._parts)
        return self._along_curve(*self._places.of(keys))

    def of_leaves(self, codes):
        """Home of each leaf.

        Local.

        Args:
            codes: (n,) int64, as `facet_pairing.leaf_code` gives them.

        Returns:
            (n,) int32 parts.
        """
        if self._cuts is None:
            return hashed(codes, self._parts)
        cell, anchor = decode_leaf(codes)
        return self._along_curve(cell, anchor + 1)

    def _along_curve(self, cell, points):
        """The part whose piece of the curve has the finest leaf that ends at points.

        Of eight around a corner this one gives the fewest partners, up to 40 at 8192 parts; 44 the one that begins
        there, 113 the corner of a leaf of twice the side (studies/partition, a million leaves).
        """
        keys = self._curve.keys(cell, np.maximum(points - 1, 0))
        return np.searchsorted(self._cuts, keys, side="right").astype(np.int32)


@lru_cache(maxsize=1)  # the forests of a run have one root mesh
def _of_roots(mesh, lattice, pairing):
    """What homes need to know of the root mesh."""
    return Places(lattice, pairing), RootCurve(mesh)


class Places:
    """One root cell, and the coordinates there, for each lattice point; for points that face each other the same.

    Local.  It is the lowest cell that has the point, one at a paired surface if there is one, of facing points the
    lower of the two.

    Args:
        lattice: Lattice.
        pairing: Pairing.
    """

    def __init__(self, lattice, pairing):
        self._lattice, self._pairing = lattice, pairing
        paired = pairing.paired
        touching = (paired[:, None] & part_faces()).any(axis=2)  # (ncells, 27)
        self._entities = lattice.entities(prefer=touching)
        _, cell, part = self._entities
        on = paired[cell] & part_faces()[part]
        self._face = np.where(on.any(axis=1), on.argmax(axis=1), -1)  # a paired facet of each entity

    def of(self, keys):
        """(n,) int64 root cells, and (n, 3) int32 lattice coordinates, of keys (n,) int64.  Local."""
        cell, points, face = self._first(keys)
        facing = np.flatnonzero(face >= 0)
        if len(facing):
            other, _, there = self._pairing.opposite(cell[facing], face[facing], points[facing, None])
            there = self._lattice.keys(other, there)[:, 0]
            other, points_there, _ = self._first(there)
            lower = (other < cell[facing]) | (other == cell[facing]) & (there < keys[facing])
            cell[facing[lower]], points[facing[lower]] = other[lower], points_there[lower]
        return cell, points

    def _first(self, keys):
        """Cell and coordinates of each key, and the paired facet there on which it lies, -1 if on none."""
        entity, points = self._lattice.located(keys, self._entities)
        return self._entities[1][entity], points, self._face[entity]
