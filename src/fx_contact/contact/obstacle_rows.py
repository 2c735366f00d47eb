"""Rows of a surface on a rigid obstacle: n . u <= g at each conforming node.

g is the signed distance of the node from the obstacle plus the clearance, n the normal into it at the closest point.
"""

import numpy as np

from fx_contact.contact.constraint_rows import RowColumns
from fx_contact.contact.contact_facets import facet_shares
from fx_contact.contact.enforcement import Enforcement
from fx_contact.contact.facet_rows import FacetRows
from fx_contact.contact.row_entries import KeyedEntries
from fx_contact.fem.prolongation import Prolongation
from fx_contact.forest.forest import Forest
from fx_contact.items.contact import ContactPair
from fx_contact.parallel.arrays import FloatArray, Int64Array, IntArray
from fx_contact.parallel.mpi import together


class ObstacleRows(FacetRows):
    """Rows without a second body."""

    def columns(self, prolongation: Prolongation, enforcement: Enforcement) -> RowColumns:
        """As `RowKind.columns`.  Collective.  Raises SceneError for functions that are not finite."""
        space, forest = prolongation.space, prolongation.space.forest
        leaf, face = self.facets(forest)
        points = space.points[leaf[:, None], space.face_nodes[face]]
        here = forest.evaluate(forest.cell[leaf], points)
        area, _ = facet_shares(space, here, face)
        regions = np.stack([forest.mesh.region[forest.cell[leaf]], np.full(len(leaf), -1)], axis=1)
        example, _, columns = self.nodal_columns(prolongation, enforcement, regions, area)
        position, count = here.reshape(-1, 3)[example], len(example)
        keys = space.keys[space.on_faces(leaf, face)].ravel()[example]
        with together(prolongation.comm):
            distance, normal = self._distances(position)
        entries = KeyedEntries(np.arange(count), keys, np.zeros(count, dtype=np.int64), np.ones(count))
        across, apart = columns["area"][:, None] * normal, distance[:, None] * normal
        return RowColumns(entries=entries, across=across, apart=apart, position=position, **columns)

    def apart(self, forest: Forest, leaf: Int64Array, face: Int64Array, points: IntArray | FloatArray) -> FloatArray:
        """Vectors to the closest points of the obstacle.  Local.  Raises SceneError as `columns`."""
        here = forest.evaluate(forest.cell[leaf], points)
        return self._vectors(here.reshape(-1, 3)).reshape(here.shape)

    def apart_from(self, position: FloatArray, normal: FloatArray) -> FloatArray:
        """As `RowKind.apart_from`, whatever the normals.  Local.  Raises SceneError as `columns`."""
        return self._vectors(position)

    def _vectors(self, points: FloatArray) -> FloatArray:
        """From points (n, 3) to the closest points of the obstacle: (n, 3) [m]."""
        distance, normal = self._distances(points)
        return distance[:, None] * normal

    def _distances(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """As `ContactPair.distances`."""
        assert isinstance(self.contact, ContactPair)
        return self.contact.distances(points)


class PlaneRows(ObstacleRows):
    """Rows of a plane, along which bodies slide."""

    SLIDES = True


class RigidFaceRows(ObstacleRows):
    """Rows along all axes of a surface that moves as a rigid body."""

    def _distances(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """0, and any direction."""
        return np.zeros(len(points)), np.tile([0.0, 0.0, 1.0], (len(points), 1))
