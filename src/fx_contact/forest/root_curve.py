"""Space-filling curve through a root mesh: Hilbert curve of the cell centres, and one inside each cell."""

import numpy as np

from fx_contact.forest.space_filling_curve import hilbert
from fx_contact.parallel.arrays import Int64Array, IntArray
from fx_contact.problem import hexahedron
from fx_contact.problem.lattice import MAX_LEVEL
from fx_contact.problem.root_mesh import RootMesh


class RootCurve:
    """Hilbert keys of points in root cells.

    Local.  The curve inside a root cell runs in local axes aligned with the global ones as closely as possible.
    """

    def __init__(self, mesh: RootMesh) -> None:
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

    def keys(self, cell: IntArray, anchor: IntArray) -> Int64Array:
        """Keys (n,) of leaves by root cells (n,) and low corners (n, 3), or of the finest leaves at points.  Local."""
        local = np.take_along_axis(anchor >> 1, self._axis[cell], axis=1)
        # The reflection of an anchor is the far corner of the reflected leaf, and lies in that leaf.
        local = np.where(self._flip[cell], (1 << MAX_LEVEL) - 1 - local, local)
        return self._position[cell] << 3 * MAX_LEVEL | hilbert(local, MAX_LEVEL)
