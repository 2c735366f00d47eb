"""Leaf facets of surfaces by name: their geometry is computed on any rank, whichever has the leaves.

A leaf facet is named by its root cell, local face, and its low corner and side on that face in lattice coordinates.
All is local.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from fx_contact.geometry import hexahedron
from fx_contact.geometry.lattice import SIDE, leaf_side
from fx_contact.geometry.root_facets import RootFacets, SurfacePoints
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int8Array, Int32Array, Int64Array, IntArray

#: Coordinates of the corners of a facet, first tangent fastest.
CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])


@dataclass(frozen=True, eq=False)
class LeafFacets:
    """Leaf facets; their coordinates (u, v) in [0, 1]^2 run along the face's first and second tangent.

    Attributes:
        root: distinct root facets.
        index: (n,), that of each leaf facet.
        low: (n, 2), lattice coordinates of the low corner along the tangents.
        side: (n,), length of the sides in lattice units.
    """

    root: RootFacets
    index: Int64Array
    low: Int32Array
    side: Int32Array

    @classmethod
    def of_leaves(
        cls, mesh: RootMesh, cell: Int32Array, level: Int8Array, anchor: Int32Array, face: Int64Array
    ) -> Self:
        """Faces (n,) of leaves by root cells (n,), levels (n,) and anchors (n, 3).  Local."""
        low = np.take_along_axis(anchor, hexahedron.FACE_TANGENTS[face], axis=1)
        code, index = np.unique(cell.astype(np.int64) * 6 + face, return_inverse=True)
        return cls(RootFacets(mesh, np.stack(np.divmod(code, 6), axis=1)), index, low, leaf_side(level))

    def __len__(self) -> int:
        return len(self.index)

    def __getitem__(self, rows: IntArray | BoolArray | slice) -> Self:
        return replace(self, index=self.index[rows], low=self.low[rows], side=self.side[rows])

    @property
    def cell(self) -> Int64Array:
        """(n,), root cells."""
        return np.asarray(self.root.facets[self.index, 0])

    @property
    def face(self) -> Int64Array:
        """(n,), local faces."""
        return np.asarray(self.root.facets[self.index, 1])

    def at(self, uv: FloatArray) -> SurfacePoints:
        """Points (n, m) at coordinates (n, m, 2), or (m, 2) on all; derivatives are by those of the leaf facets."""
        points, part = self.root.at(self.index, self._in_root(uv)), (self.side / SIDE)[:, None, None]
        return SurfacePoints(points.position, points.first * part, points.second * part, points.outward * part * part)

    def on_lines(self, origin: FloatArray, direction: FloatArray, start: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Coordinates (n, m, 2) where lines meet the facets, and (n, m) those found; as `RootFacets.on_lines`."""
        uv, found = self.root.on_lines(self.index, origin, direction, self._in_root(start))
        return (SIDE * uv - self.low[:, None]) / self.side[:, None, None], found

    def _in_root(self, uv: FloatArray) -> FloatArray:
        return np.asarray((self.low[:, None] + self.side[:, None, None] * uv) / SIDE)

    @property
    def root_range(self) -> tuple[FloatArray, FloatArray]:
        """Coordinates (n, 2) of the low and the high corner of the root facets."""
        side = self.side[:, None]
        return np.asarray(-self.low / side), np.asarray((SIDE - self.low) / side)

    @cached_property
    def corners(self) -> FloatArray:
        """(n, 4, 3), positions of the corners, first tangent fastest [m]."""
        return self.at(CORNERS).position

    @cached_property
    def mean_outward(self) -> FloatArray:
        """(n, 3), area of the corners' quadrilateral times its outward normal [m^2].

        The mean plane goes through the mean of the corners with this normal.
        """
        return np.asarray(hexahedron.area_vectors(self.corners) * self.root.orientation[self.index][:, None])

    @property
    def mean_normal(self) -> FloatArray:
        """(n, 3), unit normal of the mean plane out of the body [-]."""
        return np.asarray(self.mean_outward / np.linalg.norm(self.mean_outward, axis=1)[:, None])
