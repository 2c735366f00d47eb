"""Units of a partition in the order of the space-filling curve: leaves, or super-elements of facing leaves.

The leaves of a super-element have the curve key of one of them (section 3 of the paper).
"""

from functools import cached_property

import numpy as np

from fx_contact.forest.forest import Forest
from fx_contact.forest.leaf_graph import Graph, create_leaf_graph
from fx_contact.forest.space_filling_curve import RootCurve
from fx_contact.parallel.arrays import Int64Array
from fx_contact.problem.facet_pairing import decode_leaf, leaf_code


def curve_keys(forest: Forest, pairs: bool = True) -> Int64Array:
    """Hilbert keys (n,) of the leaves: the same for facing leaves if `pairs`, else distinct.  Local."""
    cell, anchor = decode_leaf(forest.representatives if pairs else leaf_code(forest.cell, forest.anchor))
    return RootCurve(forest.mesh).keys(cell, anchor)


class Units:
    """This rank's units, in curve order: super-elements of facing leaves if `pairs`, else single leaves.

    Local; the leaves of a super-element must be on one rank.

    Attributes:
        of_leaf: (n,), unit of each leaf.
        keys: (m,), curve key of each unit, ascending.
        weights: (m,), number of leaves of each unit.
        contact: (m,), units with a face on a contact surface.
    """

    def __init__(self, forest: Forest, pairs: bool) -> None:
        self.comm, self._forest = forest.comm, forest
        self.keys, self.of_leaf = np.unique(curve_keys(forest, pairs), return_inverse=True)
        self.weights = np.bincount(self.of_leaf, minlength=len(self.keys))
        self.contact = np.zeros(len(self.keys), dtype=bool)
        self.contact[self.of_leaf[forest.contact_faces()[0]]] = True

    def __len__(self) -> int:
        return len(self.keys)

    @cached_property
    def graph(self) -> Graph:
        """Graph of the units, weighted by the leaf facets between them.  Collective on comm at first use."""
        return create_leaf_graph(self._forest).contracted(self.of_leaf, len(self))
