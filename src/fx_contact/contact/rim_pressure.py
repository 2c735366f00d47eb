"""The contact pressure at the rim of the second surface, which crosses facets of the first.

Multipliers there have unlike areas, nodes outside of the rim too, and force over area alternates.  At the nodes j of
such facets the pressure is a mean of the multiplier lambda on the covered part C of the facets around:

    p_j = int_C W_j lambda / int_C W_j,    lambda = sum_k f_k psi_k / int psi_k.

W_j are the bilinear hats of corners.  Middles of sides have the sum of those at both ends.
"""

import numpy as np

from fx_contact.contact.constraint_rows import ConstraintRows
from fx_contact.parallel.arrays import FloatArray


class RimPressure:
    """p_j less f_j / int psi_j, for pressures f / int psi (n,) [Pa], a `PressureCorrection`.

    Collective on the prolongation's comm.
    """

    def __init__(self, rows: ConstraintRows, pressure: FloatArray, index: int) -> None:
        self._rows, self._rim, self._pressure = rows, rows.rims[index], pressure
        self._ours = np.flatnonzero(rows.contact == index)
        self._area = self._summed(self._rim.area)

    def change(self) -> FloatArray:
        """As `PressureCorrection.change`.  Collective."""
        known = self._at_nodes(self._pressure)
        moments = np.einsum("mjk,mk->mj", self._rim.moments, known)
        return self._over_area(self._summed(moments)) - self._at_rim(self._pressure)

    def transposed(self, weight: FloatArray) -> FloatArray:
        """As `PressureCorrection.transposed`.  Collective."""
        over = self._at_nodes(self._over_area(weight))
        return self._summed(np.einsum("mjk,mj->mk", self._rim.moments, over)) - self._at_rim(weight)

    def _over_area(self, values: FloatArray) -> FloatArray:
        """Values (n,) of the rows over int W, 0 inside and in rows of other contacts."""
        return np.divide(values, self._area, out=np.zeros_like(values), where=self._area > 0)

    def _at_rim(self, values: FloatArray) -> FloatArray:
        return np.where(self._area > 0, values, 0.0)

    def _at_nodes(self, values: FloatArray) -> FloatArray:
        """Values (n,) of the rows at the nodes of the facets: (m, (p+1)^2).  Collective."""
        prolongation, ours = self._rows.prolongation, self._ours
        nodal = np.zeros((prolongation.owned, 1))
        nodal[self._rows.first[ours], 0] = values[ours]
        return prolongation.ghosted(nodal)[self._rim.nodes, 0]

    def _summed(self, values: FloatArray) -> FloatArray:
        """Sums (n,) at the rows of values (m, (p+1)^2) at the nodes of the facets.  Collective."""
        sums, result = self._rows.prolongation.sums_at(self._rim.nodes, values[..., None]), np.zeros(len(self._rows))
        result[self._ours] = sums[self._rows.first[self._ours], 0]
        return result
