"""Location of points in the root mesh: root cells and reference coordinates, by Newton's method."""

import numpy as np

from fx_contact.geometry import hexahedron
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.parallel.arrays import FloatArray, Int64Array

#: Distance from a root cell, relative to its size, up to which a point belongs to it: rounding by the mesh generator.
_NEAR = 1e-6
#: Margin around the bounding box of a cell's nodes that contains the curved cell, relative to the box [-].
_MARGIN = 0.5
#: Newton steps; 4 to 7 are needed from the middle of a cell.
_STEPS = 30


def root_cells_at(mesh: RootMesh, point: FloatArray) -> tuple[Int64Array, FloatArray]:
    """Root cells (k,), ascending, that contain a point (3,) [m], and its reference coordinates (k, 3).  Local."""
    nodal = mesh.points[mesh.cells]
    low, high = nodal.min(axis=1), nodal.max(axis=1)
    size = np.linalg.norm(high - low, axis=1)
    margin = _MARGIN * (high - low) + _NEAR * size[:, None]
    cells = np.flatnonzero(((low - margin <= point) & (point <= high + margin)).all(axis=1))
    nodal, size = nodal[cells], size[cells]
    at: FloatArray = np.full((len(cells), 3), 0.5)
    for _ in range(_STEPS):
        values, slopes = _map(mesh.order, nodal, at)
        at = np.clip(at + np.linalg.solve(slopes, (point - values)[:, :, None])[:, :, 0], 0.0, 1.0)
    here = np.linalg.norm(_map(mesh.order, nodal, at)[0] - point, axis=1) <= _NEAR * size
    return cells[here], at[here]


def _map(order: int, nodal: FloatArray, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Positions (k, 3) of reference coordinates (k, 3) in cells with nodes (k, (p+1)^3, 3), and Jacobians (k, 3, 3)."""
    value, slope = hexahedron.lagrange(order, at), hexahedron.lagrange_derivative(order, at)
    columns = []
    for axis in (None, 0, 1, 2):
        x, y, z = (slope[:, i] if i == axis else value[:, i] for i in range(3))
        functions = np.einsum("nk,nj,ni->nkji", z, y, x).reshape(len(at), (order + 1) ** 3)
        columns.append(np.einsum("nm,nmd->nd", functions, nodal))
    return columns[0], np.stack(columns[1:], axis=2)
