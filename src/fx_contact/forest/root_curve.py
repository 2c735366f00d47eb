"""The space-filling curve through a root mesh: from cell to cell, and inside each."""

import numpy as np

from fx_contact.forest.space_filling_curve import hilbert
from fx_contact.problem import hexahedron
from fx_contact.problem.lattice import MAX_LEVEL


class RootCurve:
    """Hilbert keys of places in root cells.  Local.

    Root cells follow the Hilbert curve of their centres; inside a root cell the curve runs in axes that are turned to
    the global ones as closely as the cell allows.  Places are integers only, so all ranks agree to the last bit.

    Args:
        mesh: RootMesh.
    """

    def __init__(self, mesh):
        corners = mesh.points[mesh.corners]
        centres = corners.mean(axis=1)
        low = centres.min(axis=0)
        extent = max(np.ptp(centres, axis=0).max(), np.finfo(float).tiny)
        scaled = np.minimum((centres - low) / extent * (1 << 20), (1 << 20) - 1).astype(np.int64)
        self._position = np.empty(len(centres), dtype=np.int64)
        self._position[np.argsort(hilbert(scaled, 20), kind="stable")] = np.arange(len(centres))

        slope = np.einsum("va,nvg->nga", 2.0 * hexahedron.CORNERS - 1, corners)
        slope /= np.linalg.norm(slope, axis=1)[:, None]
        permutations = np.array([[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]])
        alignment = np.abs(slope[:, np.arange(3), permutations]).sum(axis=2)
        self._axis = permutations[alignment.argmax(axis=1)]
        self._flip = np.take_along_axis(slope, self._axis[:, :, None], axis=2)[:, :, 0] < 0

    def keys(self, cell, anchor):
        """Keys of leaves, or of the finest leaves that hold points.

        Local.

        Args:
            cell: (n,) int, root cells.
            anchor: (n, 3) int, low corners of leaves, or points, in lattice units, below `lattice.SIDE`.

        Returns:
            (n,) int64.
        """
        local = np.take_along_axis(anchor >> 1, self._axis[cell], axis=1)
        local = np.where(self._flip[cell], (1 << MAX_LEVEL) - 1 - local, local)
        # Flipping an anchor gives the far corner of the leaf, which lies in the same leaf: the order is that of leaves.
        return self._position[cell] << 3 * MAX_LEVEL | hilbert(local, MAX_LEVEL)
