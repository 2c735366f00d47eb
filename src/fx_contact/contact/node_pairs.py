"""Node-to-node rows of B, assembled from pairs of facing leaf facets.

The pairs of two facing facets share their area as a uniform pressure; shares of hanging nodes go to their masters.  A
row is on the rank that owns both nodes: B^T B needs no message (section 3 of the paper).
"""

import numpy as np

from fx_contact.contact.constraint_rows import RowColumns
from fx_contact.contact.contact_facets import facet_shares, positions_across
from fx_contact.contact.enforcement import Enforcement
from fx_contact.contact.facet_rows import FacetRows
from fx_contact.contact.row_entries import KeyedEntries
from fx_contact.fem.prolongation import Prolongation
from fx_contact.forest.forest import Forest
from fx_contact.parallel.arrays import FloatArray, Int64Array, IntArray


class NodePairs(FacetRows):
    """Rows of pairs of conforming nodes that face each other: B u = n . (u_first - u_second)."""

    def columns(self, prolongation: Prolongation, enforcement: Enforcement) -> RowColumns:
        """As `RowKind.columns`.  Collective."""
        space, forest = prolongation.space, prolongation.space.forest
        leaf, face = self.facets(forest)
        keys, points = space.facing(leaf, face), space.points[leaf[:, None], space.face_nodes[face]]
        here, there = positions_across(forest, leaf, face, points)
        partner = forest.pairing.partner[forest.cell[leaf], face, 0]
        (area, outward), (_, inward) = (facet_shares(space, nodes, face) for nodes in (here, there))
        regions = forest.mesh.region[np.stack([forest.cell[leaf], partner], axis=1)]
        example, across, columns = self.nodal_columns(prolongation, enforcement, regions, area, outward + inward)
        count, named = len(example), np.stack([space.keys[space.on_faces(leaf, face)], keys], axis=2).reshape(-1, 2)
        here, there = here.reshape(-1, 3)[example], there.reshape(-1, 3)[example]
        entries = KeyedEntries(
            row=np.repeat(np.arange(count), 2),
            key=named[example].ravel(),
            side=np.tile([0, 1], count),
            weight=np.tile([1.0, -1.0], count),
        )
        return RowColumns(entries=entries, across=across, apart=there - here, position=here, **columns)

    def apart(self, forest: Forest, leaf: Int64Array, face: Int64Array, points: IntArray | FloatArray) -> FloatArray:
        """Vectors to the opposite points.  Local."""
        here, there = positions_across(forest, leaf, face, points)
        return there - here
