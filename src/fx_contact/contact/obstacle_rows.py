"""Rows of a surface on a rigid obstacle: n . u <= g at each conforming node.

g is the signed distance of the node from the obstacle plus the clearance, n the normal into it at the closest point.
"""

import numpy as np

from fx_contact.contact.constraint_rows import ConstraintRows, RowColumns, RowKind
from fx_contact.contact.contact_facets import facet_shares, mean_moduli, moduli, nodal_sums, spring_stiffness
from fx_contact.contact.enforcement import Enforcement
from fx_contact.contact.pressure import FacetPressure
from fx_contact.contact.row_entries import KeyedEntries
from fx_contact.fem.prolongation import Prolongation
from fx_contact.forest.forest import Forest
from fx_contact.items.contact import ContactPair
from fx_contact.parallel.arrays import FloatArray, Int64Array, IntArray
from fx_contact.parallel.mpi import together


class ObstacleRows(RowKind):
    """Rows without a second body."""

    def columns(self, prolongation: Prolongation, enforcement: Enforcement) -> RowColumns:
        """As `RowKind.columns`.  Collective.  Raises SceneError for functions that are not finite."""
        space, forest = prolongation.space, prolongation.space.forest
        leaf, face = self.facets(forest)
        points = space.points[leaf[:, None], space.face_nodes[face]]
        here = forest.evaluate(forest.cell[leaf], points)
        area, _ = facet_shares(space, here, face)
        cell = forest.cell[leaf]
        regions, bodies = (
            np.stack([of[cell], np.full(len(cell), -1, np.int32)], axis=1)
            for of in (forest.mesh.region, forest.mesh.body)
        )
        modulus = moduli(self.scene, regions)
        stiffness, soft = spring_stiffness(enforcement, modulus, area), area[:, :, None] / modulus[:, None]
        shares = np.concatenate([area[:, :, None], soft, stiffness[:, :, None]], axis=2)
        first, example, sums = nodal_sums(prolongation, leaf, face, shares)
        of = example // points.shape[1]
        position, count = here.reshape(-1, 3)[example], len(first)
        keys = space.keys[space.on_faces(leaf, face)].ravel()[example]
        with together(prolongation.comm):
            distance, normal = self._distances(position)
        return RowColumns(
            first=first,
            entries=KeyedEntries(np.arange(count), keys, np.zeros(count, dtype=np.int64), np.ones(count)),
            across=sums[:, :1] * normal,
            apart=distance[:, None] * normal,
            area=sums[:, 0],
            stiffness=sums[:, 3],
            modulus=mean_moduli(self.scene, regions[of], sums[:, :3]),
            position=position,
            bodies=bodies[of],
        )

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

    def pressure_correction(self, rows: ConstraintRows, pressure: FloatArray) -> FacetPressure | None:
        """At degree 2 force over area alternates around the pressure."""
        degree = rows.prolongation.space.degree
        return None if degree == 1 else FacetPressure(rows, pressure, self.index)


class PlaneRows(ObstacleRows):
    """Rows of a plane, along which bodies slide."""

    SLIDES = True


class RigidFaceRows(ObstacleRows):
    """Rows along all axes of a surface that moves as a rigid body."""

    def _distances(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """0, and any direction."""
        return np.zeros(len(points)), np.tile([0.0, 0.0, 1.0], (len(points), 1))
