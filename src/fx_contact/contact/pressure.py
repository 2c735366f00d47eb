"""The contact pressure at the nodes, from the forces of node pairs.

At degree 2 force over area, p = D^-1 f with Simpson's areas D, is off by -h^2 p''/20 at vertices and by h^2 p''/40 at
middles for each direction, on smooth contact with facets of size h.  With the mass matrix M of a facet, M^-1 D p is the
pressure that has the forces D p there.  Its means over the facets of a node are off by O(h^4).

At the rim of contact M^-1 D p oscillates: it may change no nodal pressure of a facet by more than the part `_MOST`.
"""

import numpy as np

from fx_contact.contact.constraint_rows import ConstraintRows
from fx_contact.contact.contact_facets import facet_shares
from fx_contact.parallel.arrays import FloatArray

#: Largest change of a nodal pressure [-].  Errors [%] of HERTZ-A, order 6, with 33, 121 and 463 closed pairs:
#:
#:                                   largest pressure      L2 norm
#:     force over area               1.33, 0.32, 0.083     3.54, 2.14, 0.86
#:     corrected                     0.51, 0.10, 0.026     3.44, 2.10, 0.85
#:     corrected without a limit     0.51, 0.10, 0.026     3.51, 2.22, 0.94
#:
#: Limits from 0.02 to 0.4 give the same largest pressure.  Without a limit INDENT-A has pressures below 0 beside the
#: edge.
_MOST = 0.1


class FacetPressure:
    """M^-1 D - 1 on the pressed facets of a contact, limited by the pressures (n,) [Pa]: a `PressureCorrection`.

    Collective on the prolongation's comm.
    """

    def __init__(self, rows: ConstraintRows, pressure: FloatArray, index: int) -> None:
        space = rows.prolongation.space
        weights, value, _, _ = space.facet_rule
        mass = (value.T * weights) @ value
        self._matrix = np.linalg.solve(mass, np.diag(mass.sum(axis=1))) - np.eye(len(mass))
        self._rows, self._index, (leaf, face) = rows, index, rows.kinds[index].facets(space.forest)
        self._nodes = space.on_faces(leaf, face)
        nodal = self._at_facets(pressure)
        pressed = nodal.any(axis=1)
        leaf, face, nodal, self._nodes = leaf[pressed], face[pressed], nodal[pressed], self._nodes[pressed]
        points = space.points[leaf[:, None], space.face_nodes[face]]
        area, _ = facet_shares(space, space.forest.evaluate(space.forest.cell[leaf], points), face)
        changes, most = nodal @ self._matrix.T, _MOST * np.maximum(nodal, 0.0)
        part = np.divide(most, np.abs(changes), out=np.ones_like(most), where=np.abs(changes) > most).min(axis=1)
        self._weight, self._nodal = area * part[:, None], nodal

    def change(self) -> FloatArray:
        """As `PressureCorrection.change`.  Collective."""
        return self._at_rows(self._weight * (self._nodal @ self._matrix.T)) / self._rows.area

    def transposed(self, weight: FloatArray) -> FloatArray:
        """As `PressureCorrection.transposed`.  Collective."""
        return self._at_rows((self._weight * self._at_facets(weight / self._rows.area)) @ self._matrix)

    def _at_facets(self, values: FloatArray) -> FloatArray:
        """Values of the rows at the nodes of the facets: (k, (p+1)^2).  Collective."""
        return self._rows.at_nodes(self._index, values[:, None])[self._nodes, 0]

    def _at_rows(self, values: FloatArray) -> FloatArray:
        """Transpose of `_at_facets`: (n,).  Collective."""
        prolongation = self._rows.prolongation
        sums = np.zeros((len(prolongation.space), 1))
        np.add.at(sums[:, 0], self._nodes, values)
        total = prolongation.ghosted(prolongation.restrict(sums))[self._rows.first, 0]
        return np.where(self._rows.contact == self._index, total, 0.0)
