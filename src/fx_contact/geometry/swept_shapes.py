"""Shapes swept from a side of another one, whose mesh they match, on that side or on a surface of their own.

All functions are local.
"""

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from fx_contact.geometry import hexahedron
from fx_contact.geometry.shapes import Axis, Shape, images, join, rotation
from fx_contact.parallel.arrays import FloatArray, Int32Array, Int64Array, IntArray
from fx_contact.parallel.errors import GeometryError, SceneError
from fx_contact.parallel.validation import check_count, check_degrees, check_kind, check_vector, shown

#: Local faces of swept cells: at the low and the high end of the first tangent, then of the second.
_LATERAL = hexahedron.FACES[:2].ravel()
_START, _END = hexahedron.FACES[2]


def sweep_side(
    shape: Shape, side: str, path: Callable[[FloatArray, float], Sequence[npt.ArrayLike] | FloatArray], layers: int
) -> Shape:
    """Shape of the cells through which a side of another shape passes on a path, meshed like that side.

    Its sides are "start" and "end", and lateral ones with the names of the old sides that they adjoin: a "start" or
    "end" of a shape swept before goes on along the path and replaces the new one.  A shape that starts on a surface of
    its own faces the other one facet by facet:

        upper = sweep_side(lower, "top", lambda x, t: (x[0], x[1], (1 - t) * (0.1 + x[0] ** 2) + t), layers=4)

    Args:
        path: function of positions (3, n) on the side and of a number t from 0 to 1 that gives positions on the way:
            three arrays (n,), or numbers.
        layers: number of cells along the path.

    Raises SceneError for no shape, an unknown side or number of layers, GeometryError unless the path is a function
    that gives positions.
    """
    check_kind("what is swept", shape, Shape)
    check_count("the number of layers", layers)
    if not callable(path):
        raise GeometryError(
            f"the path must be a function of positions and of a number from 0 to 1, got {shown(path)}"
        )
    order, rows = shape.order, shape.side(side)
    used, facets = np.unique(shape.facet_nodes(rows), return_inverse=True)
    facets = facets.reshape(len(rows), -1)
    steps = np.linspace(0, 1, order * layers + 1)

    points = [images("the path", lambda x: path(x, t), shape.points[used]) for t in map(float, steps)]
    n = order + 1
    low, top = points[0][facets[:, [0, order, order * n]]], points[order][facets[:, 0]]
    one, other, along = low[:, 1] - low[:, 0], low[:, 2] - low[:, 0], top - low[:, 0]
    inverted = np.einsum("ni,ni->n", np.cross(one, other), along) < 0
    facets[inverted] = facets[inverted].reshape(-1, n, n).swapaxes(1, 2).reshape(-1, n * n)
    level = len(used) * (order * np.arange(layers)[:, None, None] + np.arange(n)[:, None])
    cells = (facets[None, :, None] + level[:, None]).reshape(-1, n**3)
    first, last = np.arange(len(rows)), np.arange(len(rows)) + (layers - 1) * len(rows)
    sides = {"start": _rows(first, _START), "end": _rows(last, _END)}
    sides |= _bordering(shape, rows, used[facets], layers)
    return Shape(np.concatenate(points), cells, sides)


def extrude(shape: Shape, side: str, vector: Sequence[float], layers: int) -> Shape:
    """`sweep_side` along a vector, in the unit of the mesh.  Raises SceneError for invalid arguments."""
    check_vector("the vector to extrude along", vector)
    return sweep_side(shape, side, lambda x, t: x + t * np.array(vector, np.float64)[:, None], layers)


def revolve(shape: Shape, side: str, degrees: float, layers: int, axis: Axis = "z") -> Shape:
    """`sweep_side` around an axis through the origin that the side does not meet.

    The angle is counter-clockwise seen from the tip of the axis.  The ends of a full circle, 360 degrees, are joined.
    Raises SceneError for an unknown side, an invalid number or axis, or more than a full circle, GeometryError for an
    axis of length zero.
    """
    if abs(check_degrees("an angle", degrees)) > 360:
        raise SceneError(
            f"an angle of revolution must be 360 degrees at most, got {degrees:g}: cells would penetrate each other"
        )
    whole = abs(degrees) == 360
    rotation(axis, degrees)
    result = sweep_side(shape, side, lambda x, t: rotation(axis, t * degrees) @ x, layers)
    return join(result) if whole else result


def _rows(cell: IntArray, face: int | IntArray) -> Int32Array:
    return np.stack([cell, np.broadcast_to(face, np.shape(cell))], axis=-1).reshape(-1, 2).astype(np.int32)


def _bordering(shape: Shape, rows: IntArray, facets: Int64Array, layers: int) -> dict[str, Int32Array]:
    """Lateral sides of cells swept from facets (n, 2), with nodes (n, (p+1)^2) in the frames of the new cells."""

    def edges(nodes: Int64Array) -> Int64Array:
        """Numbers (n, 4) of the edges of facets: low and high end of the first tangent, then of the second."""
        corner = nodes[:, [0, shape.order, -1 - shape.order, -1]]
        ends = np.sort(corner[:, [[0, 2], [1, 3], [0, 1], [2, 3]]], axis=2)
        return ends @ np.array([len(shape.points), 1])

    own, swept, sides = edges(facets), rows @ [6, 1], {}
    for name, others in shape.sides.items():
        if not np.isin(others @ [6, 1], swept).any():
            facet, edge = np.nonzero(np.isin(own, edges(shape.facet_nodes(others))))
            cell = facet + len(rows) * np.arange(layers)[:, None]
            if cell.size:
                sides[name] = _rows(cell, _LATERAL[edge])
    return sides
