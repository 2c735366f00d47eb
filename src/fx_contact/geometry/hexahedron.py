"""Reference hexahedron [0, 1]^3: its corners, edges, faces, and tensor-product Lagrange functions.

Corners, edges and faces are numbered as in dolfinx (Basix); nodes are in tensor order, x fastest.  The Lagrange
functions are not Basix's, since cells that share a node must place it identically to the last bit.  All is local.
"""

from collections.abc import Sequence
from functools import cache
from itertools import product

import basix
import numpy as np
import numpy.typing as npt

from fx_contact.parallel.arrays import FloatArray, Int64Array

_, _edges, _faces, _ = basix.topology(basix.CellType.hexahedron)

#: Coordinates of the corners: corner v is at (v & 1, v >> 1 & 1, v >> 2 & 1).
CORNERS: Int64Array = np.asarray(basix.geometry(basix.CellType.hexahedron)).astype(np.int64)

#: Local faces: normal axis, side (0 low, 1 high), the four corners, first tangent fastest.
FACE_CORNERS = np.array(_faces)
FACE_AXIS = np.ptp(CORNERS[FACE_CORNERS], axis=1).argmin(axis=1)
FACE_SIDE = CORNERS[FACE_CORNERS[:, 0], FACE_AXIS]
#: Local face on the low and the high side of each axis: (3, 2).
FACES = np.lexsort((FACE_SIDE, FACE_AXIS)).reshape(3, 2)
FACE_TANGENTS = np.array([[b for b in range(3) if b != axis] for axis in FACE_AXIS])

#: +1 where the first tangent times the second points out of the cell, else -1.
FACE_ORIENTATION = np.where(FACE_AXIS == 1, -1, 1) * np.where(FACE_SIDE == 1, 1, -1)

#: Local edges: running axis and the two corners, low end first.
EDGE_CORNERS = np.array(_edges)
EDGE_AXIS = np.ptp(CORNERS[EDGE_CORNERS], axis=1).argmax(axis=1)

#: Local edges of each face, at (second tangent low, second high, first low, first high).
FACE_EDGES = np.array(
    [
        [np.flatnonzero((EDGE_CORNERS == corners[ends]).all(axis=1))[0] for ends in ([0, 1], [2, 3], [0, 2], [1, 3])]
        for corners in FACE_CORNERS
    ]
)

#: The two faces that meet in each local edge.
EDGE_FACES = np.array([np.flatnonzero((FACE_EDGES == edge).any(axis=1)) for edge in range(12)])


def grid_points(order: int) -> Int64Array:
    """Integer coordinates ((p+1)^3, 3) in 0..p of the nodes of a cell of order p."""
    return np.array([ijk[::-1] for ijk in product(range(order + 1), repeat=3)], dtype=np.int64)


def order_of(count: int) -> int:
    """Order p of a cell that has (p+1)^3 nodes."""
    return round(count ** (1 / 3)) - 1


def corner_nodes(order: int) -> Int64Array:
    """Tensor indices of the eight corners among the nodes of a cell: (8,)."""
    n = order + 1
    return CORNERS @ (order * np.array([1, n, n * n]))


def face_nodes(order: int) -> Int64Array:
    """Tensor indices of the nodes of the six faces, first tangent fastest: (6, (p+1)^2)."""
    nodes = grid_points(order)
    return np.array([np.flatnonzero(nodes[:, a] == order * s) for a, s in zip(FACE_AXIS, FACE_SIDE)])


def edge_nodes(order: int) -> Int64Array:
    """Tensor indices of the nodes of the 12 edges, from the low end: (12, p+1)."""
    n = order + 1
    return corner_nodes(order)[EDGE_CORNERS[:, :1]] + np.arange(n) * np.array([1, n, n * n])[EDGE_AXIS][:, None]


def face_inner_nodes(order: int) -> Int64Array:
    """Tensor indices of the nodes inside the six faces, first tangent fastest: (6, (p-1)^2)."""
    return face_nodes(order).reshape(6, order + 1, order + 1)[:, 1:-1, 1:-1].reshape(6, -1)


def cell_inner_nodes(order: int) -> Int64Array:
    """Tensor indices of the nodes inside the cell: ((p-1)^3,)."""
    nodes = grid_points(order)
    return np.flatnonzero(((nodes > 0) & (nodes < order)).all(axis=1))


def subcells(order: int, dimension: int = 3) -> Int64Array:
    """Tensor indices of the corners of the p^d equal parts of a cell (d = 3) or face (d = 2): (p^d, 2^d)."""
    steps = (order + 1) ** np.arange(dimension)[::-1]
    low, corners = (steps @ np.indices((count,) * dimension).reshape(dimension, -1) for count in (order, 2))
    return low[:, None] + corners


def lagrange(order: int, x: npt.ArrayLike) -> FloatArray:
    """Lagrange functions of equispaced nodes on [0, 1] at points (...): (..., p+1), exact at the nodes."""
    nodes = np.arange(order + 1)
    factors = np.asarray(x)[..., None] * order - nodes
    values = np.ones((*np.shape(x), order + 1))
    for i in range(order + 1):
        for j in range(order + 1):
            if i != j:
                values[..., i] *= factors[..., j] / (i - j)
    return values


def lagrange_derivative(order: int, x: npt.ArrayLike) -> FloatArray:
    """First derivatives of `lagrange`: (..., p+1)."""
    monomials = np.linalg.inv(np.vander(np.linspace(0, 1, order + 1), increasing=True))
    powers = np.arange(1, order + 1)
    return (np.asarray(x)[..., None] ** (powers - 1) * powers) @ monomials[1:]


def face_interpolation(order: int, pieces: int) -> FloatArray:
    """Values at the lattice of a face in k x k pieces from those at its nodes: ((k+1)^2, (p+1)^2)."""
    edge = lagrange(order, np.linspace(0, 1, pieces + 1))
    return np.asarray(np.kron(edge, edge), dtype=np.float64)


def bilinear_interpolation(order: int, pieces: int) -> FloatArray:
    """As `face_interpolation`, bilinear between neighbouring nodes, which keeps values positive."""
    at, nodes = np.linspace(0, 1, pieces + 1), np.linspace(0, 1, order + 1)
    hats = np.stack([np.interp(at, nodes, unit) for unit in np.eye(order + 1)], axis=1)
    return np.kron(hats, hats)


@cache
def child_interpolation(order: int) -> FloatArray:
    """Matrices from the nodal values of a cell to those of each child: (8, (p+1)^3, (p+1)^3), exact."""
    steps = np.arange(order + 1) / order
    low, high = (lagrange(order, (side + steps) / 2) for side in (0, 1))
    axes = [[high if corner[axis] else low for axis in range(3)] for corner in CORNERS]
    return np.array([np.kron(z, np.kron(y, x)) for x, y, z in axes])


def lengths(corners: FloatArray) -> FloatArray:
    """Mean edge lengths (n, 3) [m] along each axis of cells with corners (n, 8, 3) [m]."""
    ends = corners[:, EDGE_CORNERS]
    edges = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
    return np.stack([edges[:, EDGE_AXIS == axis].mean(axis=1) for axis in range(3)], axis=1)


def area_vectors(corners: FloatArray) -> FloatArray:
    """Areas times normals (n, 3) of quadrilaterals (n, 4, 3), first tangent times the second [m^2]."""
    return np.asarray(np.cross(corners[:, 1] - corners[:, 2], corners[:, 3] - corners[:, 0]) / 2, dtype=np.float64)


def tensor_evaluate(functions: Sequence[FloatArray], nodal: FloatArray) -> FloatArray:
    """Values (n, m_x m_y m_z, d) of fields with nodal values (n, (p+1)^3, d) at tensor products of points.

    The 1D functions (m_x, p+1), (m_y, p+1) and (m_z, p+1) are at points along x, y and z.
    """
    n, _, d = nodal.shape
    fx, fy, fz = functions
    (mx, k), my, mz = fx.shape, len(fy), len(fz)
    values = fz @ nodal.reshape(n, k, k * k * d)
    values = fy @ values.reshape(n * mz, k, k * d)
    values = values.reshape(n * mz * my, k * d) @ np.kron(fx, np.eye(d)).T  # one large product beats many small ones
    return values.reshape(n, mz * my * mx, d)
