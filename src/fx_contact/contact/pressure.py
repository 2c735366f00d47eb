"""The contact pressure at the nodes, from the forces of node pairs.

At degree 2 force over area, p = D^-1 f, alternates around the true pressure: f has the integrals of p N, which
Simpson's areas D give where p is linear.  On smooth contact with facets of size h it is off by -h^2 p''/20 at vertices
and by h^2 p''/40 at middles, for each direction.  With M the mass matrix of a facet, M^-1 D p is the pressure that has
the forces D p there.  Its means over the facets of a node are off by O(h^4).

At the rim of contact and where the pressure is singular M^-1 D p oscillates instead: it may change no nodal pressure of
a facet by more than the part `_MOST`.
"""

import numpy as np

from fx_contact.contact.constraint_rows import ConstraintRows
from fx_contact.contact.contact_facets import facet_shares, facets_of
from fx_contact.parallel.arrays import FloatArray

#: Largest change of a nodal pressure [-].  Measured on HERTZ-A, order 6, with 33, 121 and 463 closed pairs.  Error of
#: the largest pressure: force over area +1.33, +0.32, +0.083 %; here, with any limit from 0.02 to 0.4 or none, +0.51,
#: +0.10, +0.026 %; p + D^-1 (f - M p) with the matrix of all facets +1.02, +0.23, +0.061 %; means of facets -4.0, -1.0,
#: -0.25 %.  In the L2 norm, most of it at the rim: force over area 3.54, 2.14, 0.86 %; here 3.44, 2.10, 0.85 %; without
#: a limit 3.51, 2.22, 0.94 %, and in INDENT-A pressures below 0 beside the edge.
_MOST = 0.1


class FacetPressure:
    """M^-1 D - 1 on the pressed facets of a contact, with the limits of the present pressures (`PressureCorrection`).

    Collective on the prolongation's comm.

    Args:
        rows: all rows.
        pressure: (n,), force over area, compression positive [Pa].
        index: of the contact.
    """

    def __init__(self, rows: ConstraintRows, pressure: FloatArray, index: int) -> None:
        space = rows.prolongation.space
        weights, value, _, _ = space.facet_rule
        mass = (value.T * weights) @ value
        self._matrix = np.linalg.solve(mass, np.diag(mass.sum(axis=1))) - np.eye(len(mass))
        self._rows, self._ours, (leaf, face) = rows, rows.contact == index, facets_of(index, space.forest)
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
        """Correction of the pressures, 0 in rows of other contacts: (n,) [Pa].  Collective."""
        return self._at_rows(self._weight * (self._nodal @ self._matrix.T)) / self._rows.area

    def transposed(self, weight: FloatArray) -> FloatArray:
        """Transpose of `change` as a map of pressures, of weights (n,): (n,).  Collective."""
        return self._at_rows((self._weight * self._at_facets(weight / self._rows.area)) @ self._matrix)

    def _at_facets(self, values: FloatArray) -> FloatArray:
        """Values of the rows at the nodes of the facets: (k, (p+1)^2).  Collective."""
        prolongation = self._rows.prolongation
        known = prolongation.zeros(1)
        known[self._rows.first[self._ours], 0] = values[self._ours]
        return prolongation.prolong(prolongation.summed(known))[self._nodes, 0]

    def _at_rows(self, values: FloatArray) -> FloatArray:
        """Transpose of `_at_facets`: (n,).  Collective."""
        prolongation = self._rows.prolongation
        sums = np.zeros((len(prolongation.space), 1))
        np.add.at(sums[:, 0], self._nodes, values)
        total = prolongation.ghosted(prolongation.restrict(sums))[self._rows.first, 0]
        return np.where(self._ours, total, 0.0)
