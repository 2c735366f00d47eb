"""Leaf facets that face each other across contact surfaces whose meshes do not match."""

from functools import cached_property

import numpy as np

from fx_contact.forest.leaves import Leaves
from fx_contact.geometry.lattice import SIDE
from fx_contact.geometry.leaf_facets import LeafFacets
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int64Array, IntArray
from fx_contact.parallel.box_search import Boxes, meeting_boxes
from fx_contact.parallel.exchange import Exchange
from fx_contact.parallel.mpi import Directory
from fx_contact.surfaces.facet_pairing import leaf_code
from fx_contact.surfaces.nonmatching import SAMPLES, NonmatchingSurfaces
from fx_contact.surfaces.surface_projection import Projected

#: Part of their extent by which the box around its samples is enlarged: 1/6 to the edges, and as much for curvature.
_MARGIN = 1 / 3
#: Facets of the first surface are refined while they are this much larger than those they face; refinement halves.
_LARGER = 2**0.5


class FacingFacets:
    """This rank's leaf facets on the first surface, and those of any rank on the second that they may face.

    Collective on leaves.comm.

    Attributes:
        leaf, face: (n,), leaves and local faces of the first.
        first: (n,).
        second: (m,), distinct.
        level: (m,), of the leaves of the second.
        anchor: (m, 3), of the leaves of the second.
        rank: (m,), that has the second.
        pairs: (k, 2), numbers of the first and the second.
        faced: (k,), pairs of which a sample of the first faces the second.
    """

    def __init__(self, leaves: Leaves, surfaces: NonmatchingSurfaces) -> None:
        self._leaves = leaves
        self.leaf, self.face = leaves.boundary_faces(surfaces.first.facets)
        first = self.first = leaves.facets(self.leaf, self.face)
        places, around = _faced(surfaces, first)
        self._on_second = leaves.boundary_faces(surfaces.second.facets)
        mine, my_face = self._on_second
        rank = np.full(len(mine), leaves.comm.rank)
        names = np.column_stack([leaves.cell[mine], leaves.level[mine], my_face, leaves.anchor[mine], rank])
        boxes = _around(leaves.facets(mine, my_face).at(SAMPLES).position)
        asked, name = meeting_boxes(leaves.comm, around, boxes, names.astype(np.int64))
        name, number = np.unique(name, axis=0, return_inverse=True)
        cell, self.level = name[:, 0].astype(np.int32), name[:, 1].astype(np.int8)
        self.anchor, self.rank = name[:, 3:6].astype(np.int32), name[:, 6]
        second = self.second = LeafFacets.of_leaves(leaves.mesh, cell, self.level, self.anchor, name[:, 2])
        pairs = np.stack([asked, number.ravel()], axis=1)
        sides = (np.stack([side.cell, side.face], axis=1)[column] for side, column in zip((first, second), pairs.T))
        self.pairs = pairs[~surfaces.joined_before(*sides)]
        one, two = self.pairs.T
        self.faced = _on(second[two], surfaces.second.facets, places.facet[one], places.uv[one])

    @cached_property
    def _known(self) -> tuple[Int64Array, Directory]:
        """This rank's leaves on the second surface, and the directory of their codes."""
        mine = np.unique(self._on_second[0])
        codes = leaf_code(self._leaves.cell[mine], self._leaves.anchor[mine])
        return mine, Directory(self._leaves.comm, codes, self._leaves.homes.of_leaves)

    @cached_property
    def covered(self) -> tuple[tuple[Int64Array, Int64Array], tuple[Int64Array, Int64Array]]:
        """This rank's leaves and local faces on the first surface, then on the second, that face the other one.

        Collective at first use.
        """
        one, two = (np.unique(column) for column in self.pairs[self.faced].T)
        away = Exchange(self._leaves.comm, self.rank[two])
        codes = leaf_code(self.second.cell[two].astype(np.int32), self.anchor[two])
        mine, my_face = self._on_second
        names = np.column_stack([leaf_code(self._leaves.cell[mine], self._leaves.anchor[mine]), my_face])
        asked = np.column_stack([away.forward(codes), away.forward(self.second.face[two])])
        both = np.unique(np.concatenate([names, asked]), axis=0, return_inverse=True)[1].ravel()
        there = np.isin(both[: len(mine)], both[len(mine) :])
        return (self.leaf[one], self.face[one]), (mine[there], my_face[there])

    @property
    def split(self) -> int:
        """Number of this rank's pairs that face each other, of which the second is on another rank.  Local."""
        return int((self.rank[self.pairs[self.faced, 1]] != self._leaves.comm.rank).sum())

    def too_large(self, marked: BoolArray) -> BoolArray:
        """Leaves (n,) whose facets are larger than those they face once marked leaves (n,) are refined.  Collective."""
        mine, directory = self._known
        codes = leaf_code(self.second.cell.astype(np.int32), self.anchor)
        _, refined = directory.lookup(codes, marked[mine], marked[mine])
        size = self.second.root.size[self.second.index] * self.second.side / SIDE
        size = np.where(refined, size / 2, size)
        least = np.full(len(self.first), np.inf)
        one, two = self.pairs[self.faced].T
        np.minimum.at(least, one, size[two])
        own = self.first.root.size[self.first.index] * self.first.side / SIDE
        return np.isin(np.arange(len(marked)), self.leaf[own > _LARGER * least]) & ~marked


def _faced(surfaces: NonmatchingSurfaces, first: LeafFacets) -> tuple[Projected, Boxes]:
    """Places on the second surface that samples (n, 16) of first facets face, and boxes (n,) around these places."""
    at = first.at(SAMPLES)
    normal = surfaces.directions(at.normal)
    found = surfaces.faced(at.position, normal)
    none = ~found.found.any(axis=1)
    # Samples that face nothing are moved as the nearest place of the others is; if all do, both ways.
    least = np.where(none, 0.0, np.where(found.found, found.distance, np.inf).min(axis=1, initial=np.inf))
    there = at.position + np.where(found.found, found.distance, least[:, None])[..., None] * normal
    reach = np.zeros((len(first), 1, 1))
    size = np.ptp(at.position[none], axis=1).max(axis=1)
    reach[none, 0, 0] = surfaces.nearest(at.position[none].mean(axis=1)) + 2 * size
    before, behind = _around(there - reach * normal), _around(there + reach * normal)
    return found, Boxes(np.minimum(before.low, behind.low), np.maximum(before.high, behind.high))


def _on(facets: LeafFacets, roots: IntArray, root: IntArray, uv: FloatArray) -> BoolArray:
    """Leaf facets (k,) that have one of their places.

    The places are numbers (k, m) of root facets (l, 2), -1: none, and coordinates (k, m, 2) on these.
    """
    at = roots[root]  # of no facet the last, which does not count
    same = (root >= 0) & (at == np.stack([facets.cell, facets.face], axis=1)[:, None]).all(axis=2)
    place = SIDE * uv - facets.low[:, None]
    inside = ((place >= 0) & (place <= facets.side[:, None, None])).all(axis=2)
    return np.asarray((same & inside).any(axis=1))


def _around(points: FloatArray) -> Boxes:
    """Enlarged boxes around samples (n, m, 3)."""
    low, high = points.min(axis=1), points.max(axis=1)
    margin = _MARGIN * (high - low).max(axis=1, keepdims=True)
    return Boxes(low - margin, high + margin)
