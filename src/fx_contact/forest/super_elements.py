"""The units of a partition, in the order of the space-filling curve: leaves, or super-elements of facing leaves.

Facing leaves take the curve key of one of them: these are the super-elements of the paper (section 3).
"""

from functools import cached_property

import numpy as np

from fx_contact.forest.leaf_graph import create_leaf_graph
from fx_contact.forest.root_curve import RootCurve
from fx_contact.problem.facet_pairing import decode_leaf, leaf_code


def curve_keys(forest, pairs=True):
    """Hilbert key of each leaf.

    Local.

    Args:
        forest: Forest.
        pairs: whether facing leaves get the same key; else all keys are distinct.

    Returns:
        (n,) int64 keys.
    """
    cell, anchor = decode_leaf(forest.representatives if pairs else leaf_code(forest.cell, forest.anchor))
    return RootCurve(forest.mesh).keys(cell, anchor)


class Units:
    """Groups of facing leaves and single leaves, in curve order on each rank.

    Local; the leaves of a group must be on one rank.

    Args:
        forest: Forest.
        pairs: whether facing leaves are one unit, a super-element; else every leaf is for itself.

    Attributes:
        comm: MPI communicator of the forest.
        of_leaf: (n,) int64, unit of each leaf.
        keys: (m,) int64, curve key of each unit, ascending.
        weights: (m,) int64, leaves of each unit.
        contact: (m,) bool, whether a unit has a face on a contact surface.
    """

    def __init__(self, forest, pairs):
        self.comm, self._forest = forest.comm, forest
        self.keys, self.of_leaf = np.unique(curve_keys(forest, pairs), return_inverse=True)
        self.weights = np.bincount(self.of_leaf, minlength=len(self.keys))
        self.contact = np.zeros(len(self.keys), dtype=bool)
        self.contact[self.of_leaf[forest.contact_faces()[0]]] = True

    def __len__(self):
        return len(self.keys)

    @cached_property
    def graph(self):
        """Graph of the units, weighted by the leaf facets between them.  Collective on comm at first use."""
        return create_leaf_graph(self._forest).contracted(self.of_leaf, len(self))
