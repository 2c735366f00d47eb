"""The contact pressure at the nodes, from the forces of node pairs.

At degree 2 force over area, p = D^-1 f with Simpson's areas D, is off by -h^2 p''/20 at vertices and by h^2 p''/40 at
middles for each direction, on smooth contact with facets of size h.  With the mass matrix M of a facet, M^-1 D p is the
pressure that has the forces D p there.  Its means over the facets of a node are off by O(h^4).

At the rim of contact M^-1 D p oscillates: it may change no nodal pressure of a facet by more than the part `_MOST`.
Beside another material, where p may jump, it changes none.
"""

import numpy as np

from fx_contact.contact.constraint_rows import ConstraintRows
from fx_contact.contact.contact_facets import facet_shares
from fx_contact.fem.space import Space
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int64Array

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
#: Difference of moduli that is rounding.
_ALIKE = 1e-9


class ContactSurface:
    """The facets of a contact, and values of its rows at their nodes.

    Collective on the prolongation's comm; so are all methods.
    """

    def __init__(self, rows: ConstraintRows, index: int) -> None:
        self._rows, self._index = rows, index
        space = rows.prolongation.space
        self.leaf, face = rows.kinds[index].facets(space.forest)
        self.nodes = space.on_faces(self.leaf, face)
        points = space.points[self.leaf[:, None], space.face_nodes[face]]
        self.area, _ = facet_shares(space, space.forest.evaluate(space.forest.cell[self.leaf], points), face)

    @staticmethod
    def mass(space: Space) -> FloatArray:
        """D^-1 M of a facet: ((p+1)^2, (p+1)^2) [-]."""
        weights, value, _, _ = space.facet_rule
        mass = (value.T * weights) @ value
        return np.asarray(mass / mass.sum(axis=1)[:, None])

    def at_facets(self, values: FloatArray) -> FloatArray:
        """Values of the rows at the nodes of the facets: (k, (p+1)^2)."""
        return self._rows.at_nodes(self._index, values[:, None])[self.nodes, 0]

    def at_rows(self, values: FloatArray) -> FloatArray:
        """Transpose of `at_facets`: (n,)."""
        prolongation = self._rows.prolongation
        sums = np.zeros((len(prolongation.space), 1))
        np.add.at(sums[:, 0], self.nodes, values)
        total = prolongation.ghosted(prolongation.restrict(sums))[self._rows.first, 0]
        return np.where(self._rows.contact == self._index, total, 0.0)

    def smoothing(self, pressure: FloatArray) -> FloatArray:
        """D^-1 M p - p of nodal pressures p (n,) [Pa]: (n,), 0 in rows of other contacts."""
        nodal = self.at_facets(pressure)
        change = nodal @ self.mass(self._rows.prolongation.space).T - nodal
        return self.at_rows(self.area * change) / self._rows.area


class FacetPressure:
    """M^-1 D - 1 on the pressed facets of a contact, limited by the pressures (n,) [Pa]: a `PressureCorrection`.

    Collective on the prolongation's comm.
    """

    def __init__(self, rows: ConstraintRows, pressure: FloatArray, index: int) -> None:
        self._rows, self._surface = rows, ContactSurface(rows, index)
        mass = self._surface.mass(rows.prolongation.space)
        self._matrix = np.linalg.inv(mass) - np.eye(len(mass))
        self._nodal = self._surface.at_facets(pressure)
        changes, most = self._nodal @ self._matrix.T, _MOST * np.maximum(self._nodal, 0.0)
        part = np.divide(most, np.abs(changes), out=np.ones_like(most), where=np.abs(changes) > most).min(axis=1)
        part[~self._nodal.any(axis=1) | self._uneven()] = 0.0
        self._weight = self._surface.area * part[:, None]

    def _uneven(self) -> BoolArray:
        """Facets beside another material on either surface, where the pressure may jump: (k,)."""
        soft = np.stack([self._surface.at_facets(1 / side) for side in self._rows.modulus.T])
        least = np.where(soft > 0, soft, np.inf).min(axis=2)
        return np.asarray((soft.max(axis=2) > (1 + _ALIKE) * least).any(axis=0))

    def change(self) -> FloatArray:
        """As `PressureCorrection.change`.  Collective."""
        return self._surface.at_rows(self._weight * (self._nodal @ self._matrix.T)) / self._rows.area

    def transposed(self, weight: FloatArray) -> FloatArray:
        """As `PressureCorrection.transposed`.  Collective."""
        values = self._weight * self._surface.at_facets(weight / self._rows.area)
        return self._surface.at_rows(values @ self._matrix)


def pressure_change(rows: ConstraintRows, pressure: FloatArray) -> FloatArray:
    """D^-1 M p - p of nodal pressures p (n,) [Pa]: (n,).  Collective."""
    surfaces = (ContactSurface(rows, kind.index) for kind in rows.kinds)
    return np.asarray(sum((surface.smoothing(pressure) for surface in surfaces), np.zeros(len(rows))))


def leaves_of_rows(rows: ConstraintRows, some: BoolArray) -> Int64Array:
    """This rank's leaves on the first surfaces with a node of some rows (n,), or one that hangs on it.  Collective."""
    surfaces = [ContactSurface(rows, kind.index) for kind in rows.kinds]
    return np.concatenate([s.leaf[(s.at_facets(some.astype(float)) != 0).any(axis=1)] for s in surfaces])
