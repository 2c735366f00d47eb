"""Rows of single nodes of the first surface, with their shares of the facets around them."""

from typing import Any

import numpy as np

from fx_contact.contact.constraint_rows import ConstraintRows, RowKind
from fx_contact.contact.contact_facets import mean_moduli, moduli, nodal_sums, spring_stiffness
from fx_contact.contact.enforcement import Enforcement
from fx_contact.contact.pressure import FacetPressure
from fx_contact.fem.prolongation import Prolongation
from fx_contact.parallel.arrays import FloatArray, Int64Array, IntArray


class FacetRows(RowKind):
    """Rows of the conforming nodes of the first surface, one each."""

    def nodal_columns(
        self, prolongation: Prolongation, enforcement: Enforcement, regions: IntArray, *shares: FloatArray
    ) -> tuple[Int64Array, FloatArray, dict[str, Any]]:
        """Columns of `RowColumns` by the shares of nodes in this rank's facets (n,).  Collective.

        Args:
            regions: (n, 2), of the mesh on both sides of the facets, -1: an obstacle.
            shares: (n, k), of the nodes in the areas of the facets [m^2], then others (n, k, ...).

        Returns:
            (m,), an example of each row's node in the raveled facet nodes; (m, ...), sums of the other shares; the
            columns by name.
        """
        area, *others = shares
        modulus = moduli(self.scene, regions)
        stiffness, soft = spring_stiffness(enforcement, modulus, area), area[:, :, None] / modulus[:, None]
        every = np.concatenate([area[:, :, None], soft, stiffness[:, :, None], *others], axis=2)
        first, example, sums = nodal_sums(prolongation, *self.facets(prolongation.space.forest), every)
        regions = regions[example // area.shape[1]]
        modulus = mean_moduli(self.scene, regions, sums[:, :3])
        bodies = np.append(self.scene.mesh.body_of_region, np.int32(-1))[regions]
        columns = {"first": first, "area": sums[:, 0], "stiffness": sums[:, 3], "modulus": modulus, "bodies": bodies}
        return example, sums[:, 4:], columns

    def pressure_correction(self, rows: ConstraintRows, pressure: FloatArray) -> FacetPressure | None:
        """At degree 2 force over area alternates around the pressure."""
        degree = rows.prolongation.space.degree
        return None if degree == 1 else FacetPressure(rows, pressure, self.index)
