"""The units of a partition, in the order of the space-filling curve: leaves, or super-elements of facing leaves.

Facing leaves take the curve key of one of them: these are the super-elements of the paper (section 3).
"""

from functools import cached_property

import numpy as np

from fx_contact.forest import space_filling_curve
from fx_contact.forest.leaf_graph import create_leaf_graph
from fx_contact.problem import hexahedron
from fx_contact.problem.facet_pairing import decode_leaf, leaf_code
from fx_contact.problem.lattice import MAX_LEVEL


def curve_keys(forest, pairs=True):
    """Hilbert key of each leaf.

    Local.  Root cells follow the Hilbert curve of their centres; inside a root cell the curve runs in axes that are
    turned to the global ones as closely as the cell allows.  Integers only, so all ranks agree to the last bit.

    Args:
        forest: Forest.
        pairs: whether facing leaves get the same key; else all keys are distinct.

    Returns:
        (n,) int64 keys.
    """
    cell, anchor = decode_leaf(forest.representatives if pairs else leaf_code(forest.cell, forest.anchor))
    position, axis, flip = _root_curve(forest.mesh)
    local = np.take_along_axis(anchor >> 1, axis[cell], axis=1)
    local = np.where(flip[cell], (1 << MAX_LEVEL) - 1 - local, local)
    # Flipping an anchor gives the far corner of the leaf, which lies in the same leaf: the order is that of the leaves.
    return position[cell] << 3 * MAX_LEVEL | space_filling_curve.hilbert(local, MAX_LEVEL)


def _root_curve(mesh):
    """Position of each root cell on the curve, and its local axes (ncells, 3) and flips along the global ones."""
    corners = mesh.points[mesh.corners]
    centres = corners.mean(axis=1)
    low = centres.min(axis=0)
    extent = max(np.ptp(centres, axis=0).max(), np.finfo(float).tiny)
    scaled = np.minimum((centres - low) / extent * (1 << 20), (1 << 20) - 1).astype(np.int64)
    position = np.empty(len(centres), dtype=np.int64)
    position[np.argsort(space_filling_curve.hilbert(scaled, 20), kind="stable")] = np.arange(len(centres))

    slope = np.einsum("va,nvg->nga", 2.0 * hexahedron.CORNERS - 1, corners)
    slope /= np.linalg.norm(slope, axis=1)[:, None]
    permutations = np.array([[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]])
    alignment = np.abs(slope[:, np.arange(3), permutations]).sum(axis=2)
    axis = permutations[alignment.argmax(axis=1)]
    flip = np.take_along_axis(slope, axis[:, :, None], axis=2)[:, :, 0] < 0
    return position, axis, flip


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
