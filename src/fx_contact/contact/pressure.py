"""The contact pressure at the nodes, from the forces of node pairs.

At degree 2 force over area, p = D^-1 f, alternates around the true pressure: f has the integrals of p N, which
Simpson's areas D give where p is linear.  On smooth contact with facets of size h it is off by -h^2 p''/20 at vertices
and by h^2 p''/40 at middles, for each direction.  With M the mass matrix of a facet, M^-1 D p is the pressure that has
the forces D p there.  Its means over the facets of a node are off by O(h^4).

At the rim of contact and where the pressure is singular M^-1 D p oscillates instead: it may change no nodal pressure of
a facet by more than the part `_MOST`.
"""

import numpy as np
import numpy.typing as npt

from fx_contact.contact.constraint_rows import ConstraintRows
from fx_contact.contact.contact_facets import facet_shares, facets_of

#: Largest change of a nodal pressure [-].  Measured on HERTZ-A, order 6, with 33, 121 and 463 closed pairs.  Error of
#: the largest pressure: force over area +1.33, +0.32, +0.083 %; here, with any limit from 0.02 to 0.4 or none, +0.51,
#: +0.10, +0.026 %; p + D^-1 (f - M p) with the matrix of all facets +1.02, +0.23, +0.061 %; means of facets -4.0, -1.0,
#: -0.25 %.  In the L2 norm, most of it at the rim: force over area 3.54, 2.14, 0.86 %; here 3.44, 2.10, 0.85 %; without
#: a limit 3.51, 2.22, 0.94 %, and in INDENT-A pressures below 0 beside the edge.
_MOST = 0.1


def pressure_change(rows: ConstraintRows, pressure: npt.NDArray[np.float64], index: int) -> npt.NDArray[np.float64]:
    """Correction of force over area at the nodes of the node pairs of a contact.

    Collective on the prolongation's comm.

    Args:
        pressure: (n,) force over area, compression positive, 0 in rows of other contacts [Pa].
        index: of the contact.

    Returns:
        (n,) [Pa], 0 at degree 1, and in rows of other contacts.
    """
    prolongation, space = rows.prolongation, rows.prolongation.space
    if space.degree == 1:
        return np.zeros(len(pressure))
    weights, value, _, _ = space.facet_rule
    mass = (value.T * weights) @ value
    change = np.linalg.solve(mass, np.diag(mass.sum(axis=1))) - np.eye(len(mass))
    leaf, face = facets_of(index, space.forest)
    known, sums = prolongation.zeros(1), np.zeros((len(space), 1))
    np.add.at(known[:, 0], rows.first, pressure)
    nodal = prolongation.prolong(prolongation.summed(known))[space.on_faces(leaf, face), 0]
    pressed = nodal.any(axis=1)
    leaf, face, nodal = leaf[pressed], face[pressed], nodal[pressed]
    points = space.points[leaf[:, None], space.face_nodes[face]]
    area, _ = facet_shares(space, space.forest.evaluate(space.forest.cell[leaf], points), face)
    changes, most = nodal @ change.T, _MOST * np.maximum(nodal, 0.0)
    part = np.divide(most, np.abs(changes), out=np.ones_like(most), where=np.abs(changes) > most).min(axis=1)
    np.add.at(sums[:, 0], space.on_faces(leaf, face), area * part[:, None] * changes)
    total = prolongation.ghosted(prolongation.restrict(sums))[rows.first, 0]
    return np.where(rows.contact == index, total / rows.area, 0.0)
