"""Strain and rotation of each cell, by the trilinear maps of its corners, without a form to compile."""

import numpy as np
from dolfinx import fem

from fx_contact.geometry.hexahedron import CORNERS
from fx_contact.parallel import compat
from fx_contact.parallel.arrays import FloatArray

#: Differences of the values at the corners along each axis of a cell, in the mean: the derivatives in its middle.
_DIFFERENCES = (2 * CORNERS.T - 1) / 4
#: Cells at once: few enough for the processor's cache.
_CHUNK = 1 << 12


def cell_strains(displacement: fem.Function) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Strain |sym grad u| [-], rotation |curl u| / 2 [rad] and volume [m^3], each (ncells,), of a displacement u [m].

    Local.  In the middle of a cell, exact where u and the map of the cell are linear.
    """
    # The corners are the first nodes of a Lagrange element, in tensor order.
    space, nodal = displacement.function_space, displacement.x.array.reshape(-1, 3)
    points, at, on = space.mesh.geometry.x, compat.geometry_nodes(space.mesh)[:, :8], space.dofmap.list[:, :8]
    strain, rotation, volume = np.empty((3, len(on)))
    for start in range(0, len(on), _CHUNK):
        part = slice(start, start + _CHUNK)
        x, y, z = (_DIFFERENCES @ points[at[part]]).swapaxes(0, 1)
        dual = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=1)
        volume[part] = np.einsum("ni,ni->n", x, dual[:, 0])
        slopes = _DIFFERENCES @ nodal[on[part]]
        gradient = slopes.swapaxes(1, 2) @ dual / volume[part, None, None]
        strain[part] = np.linalg.norm(gradient + gradient.swapaxes(1, 2), axis=(1, 2)) / 2
        rotation[part] = np.linalg.norm(gradient - gradient.swapaxes(1, 2), axis=(1, 2)) / np.sqrt(8)
    return strain, rotation, volume
