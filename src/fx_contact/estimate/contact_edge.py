"""Error of a quantity of interest by the edge of the contact, which the mesh places at nodes.

The adjoint solution z of a fixed set of closed rows has the jump B z = d there; d contains the motions of obstacles
below forces.  Where exact contact goes on beyond, with the pressure p, it contributes int p (d - B z) dA, d continued.
Let the edge be at the part s of the way from a closed node to an open one.  Up to it p falls from p_c to 0 as
(1 - t/s)^(1/2).  The jump d - B z grows as t^(1/2) to its value at the open node.  The mean over all s is

    int_0^1 int_0^s t^(1/2) (1 - t/s)^(1/2) dt ds = pi / 8 int_0^1 s^(3/2) ds = pi / 20.

Source of both profiles: K. L. Johnson, Contact Mechanics, Cambridge University Press, 1985, sections 2.8 and 4.2.
"""

import numpy as np

from fx_contact.contact.constraint_rows import RowKind
from fx_contact.estimate.solved_state import SolvedState
from fx_contact.geometry import hexahedron
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int64Array, IntArray

#: As above [-].
_SHARE = np.pi / 20
#: Nodes are closed, or open, from this value on: hanging ones have a mean of others [-].
_SOME = 0.5


def cells_at_edge(state: SolvedState) -> BoolArray:
    """Cells (ncells,) whose facets in contact have closed and open nodes, or nodes that stick and that slip.

    Collective on state.forest.comm.
    """
    rows, forest, active, slips = state.contact_rows, state.forest, state.solution.active, state.solution.slides
    entries, prolongation = rows.entries, rows.prolongation
    nodal, result = prolongation.zeros(4), np.zeros(len(forest), dtype=bool)
    status = np.column_stack([active, ~active, active & ~slips, slips])[entries.row]
    np.add.at(nodal, entries.node, np.abs(entries.weight)[:, None] * status)
    leaf, face = forest.contact_faces()
    some = prolongation.prolong(prolongation.summed(nodal))[prolongation.space.on_faces(leaf, face)] > _SOME
    result[leaf[np.any(some, axis=1).reshape(-1, 2, 2).all(axis=2).any(axis=1)]] = True
    return result[state.elasticity.leaf_mesh.leaf]


class ContactEdge:
    """Parts of facets between closed and open nodes.

    Collective on state.forest.comm.

    Args:
        state: with rows.
    """

    def __init__(self, state: SolvedState) -> None:
        self._rows, self._leaves, self._leaf = state.contact_rows, len(state.forest), state.elasticity.leaf_mesh.leaf
        self._parts = [self._parts_of(state, kind) for kind in self._rows.kinds]

    def on_cells(self, jump: FloatArray) -> FloatArray:
        """int p |d - B z| dA of each cell: (ncells,), by d - B z in the rows (n,), 0 in closed ones.

        Collective.
        """
        of_leaf = np.zeros(self._leaves)
        for kind, (leaf, corners, force) in zip(self._rows.kinds, self._parts):
            nodal = self._rows.at_nodes(kind.index, np.abs(jump)[:, None])[:, 0]
            np.add.at(of_leaf, leaf, force * np.maximum(nodal[corners], 0.0).sum(axis=1))
        return of_leaf[self._leaf]

    def _parts_of(self, state: SolvedState, kind: RowKind) -> tuple[Int64Array, IntArray, FloatArray]:
        """Leaf (m,), corner nodes (m, 4), and force over the number of open corners (m,) [N] of the parts of a kind."""
        rows, forest, space = self._rows, state.forest, self._rows.prolongation.space
        leaf, face = kind.facets(forest)
        corners = space.on_faces(leaf, face)[:, hexahedron.subcells(space.degree, 2)]
        active = state.solution.active
        nodal = rows.at_nodes(kind.index, np.column_stack([state.solution.pressure, active, ~active]))[corners]
        pressure, closed, left = np.maximum(nodal, 0.0).sum(axis=2).transpose(2, 0, 1)  # hanging nodes extrapolate
        facet, part = at = np.nonzero((closed > 0) & (left > 0))
        leaf, face = leaf[facet], face[facet]
        area = np.linalg.norm(forest.facets(leaf, face).mean_outward, axis=1) / space.degree**2
        return leaf, corners[facet, part], _SHARE * area * pressure[at] / closed[at] / left[at]
