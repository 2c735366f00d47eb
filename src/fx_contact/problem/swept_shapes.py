"""Shapes swept from a side of another one, which they meet facet by facet, there or on a surface of their own.

All functions are local.
"""

import numpy as np

from fx_contact.parallel.validation import check_count, check_number, check_vector
from fx_contact.problem import hexahedron
from fx_contact.problem.shapes import Shape, images, join, rotation

#: Local faces of swept cells: at the low and the high end of the first tangent, then of the second.
_LATERAL = [
    [np.flatnonzero((hexahedron.FACE_AXIS == a) & (hexahedron.FACE_SIDE == s))[0] for s in (0, 1)] for a in (0, 1)
]
_START, _END = (np.flatnonzero((hexahedron.FACE_AXIS == 2) & (hexahedron.FACE_SIDE == s))[0] for s in (0, 1))


def sweep_side(shape, side, path, layers):
    """A new shape of the cells that a side of another one passes through on a path: meshed as that side is.

    What begins on the other's side, moved onto a surface of its own, meets it facet by facet:

        upper = sweep_side(lower, "top", lambda x, t: (x[0], x[1], (1 - t) * (0.1 + x[0] ** 2) + t), layers=4)

    Args:
        shape: Shape.
        side: name of one of its sides.
        path: function of positions (3, n) on the side, and of a number t from 0 to 1, that gives positions on the way:
            three arrays (n,), or numbers.
        layers: cells along the path.

    Returns:
        Shape with the sides "start" and "end", and others named as the sides of the old shape that they border on.

    Raises:
        SceneError: an unknown side, or layers that are no number of cells.
        GeometryError: the function gives no positions.
    """
    check_count("the number of layers", layers)
    order, rows = shape.order, shape.side(side)
    used, facets = np.unique(shape.facet_nodes(rows), return_inverse=True)
    facets = facets.reshape(len(rows), -1)
    steps = np.linspace(0, 1, order * layers + 1)
    points = [images("the path", lambda x, t=t: path(x, float(t)), shape.points[used]) for t in steps]
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


def extrude(shape, side, vector, layers):
    """`sweep_side` along a vector.

    Args:
        shape, side, layers: as in `sweep_side`.
        vector: three numbers, in the unit of the mesh.

    Returns:
        Shape.

    Raises:
        SceneError: an unknown side, or what is no vector or number of cells.
    """
    check_vector("the vector to extrude along", vector)
    return sweep_side(shape, side, lambda x, t: x + t * np.array(vector, np.float64)[:, None], layers)


def revolve(shape, side, degrees, layers, axis="z"):
    """`sweep_side` around an axis through the origin; around the full circle, 360 degrees, the ends are joined.

    Args:
        shape, side: as in `sweep_side`.
        degrees: angle, counter-clockwise seen from the tip of the axis; the side must not meet the axis.
        layers: cells around.
        axis: "x", "y" or "z", or three numbers: a direction.

    Returns:
        Shape.

    Raises:
        SceneError: an unknown side, or what is no number or axis.
        GeometryError: an axis without direction.
    """
    whole = abs(check_number("an angle", degrees)) == 360
    rotation(axis, degrees)
    result = sweep_side(shape, side, lambda x, t: rotation(axis, t * degrees) @ x, layers)
    return join(result) if whole else result


def _rows(cell, face):
    """Rows (cell, local face): (n, 2) int32."""
    return np.stack([cell, np.broadcast_to(face, np.shape(cell))], axis=-1).reshape(-1, 2).astype(np.int32)


def _bordering(shape, rows, facets, layers):
    """Sides of swept cells where the swept side borders on others of its shape, by the names of these.

    Args:
        shape: that is swept from.
        rows: (n, 2) int32, the swept facets.
        facets: (n, (p+1)^2) int64, their nodes in the frames of the new cells.
        layers: of new cells.
    """

    def edges(nodes):
        """The edges of facets as numbers, low and high end of the first tangent, then of the second: (n, 4) int64."""
        corner = nodes[:, [0, shape.order, -1 - shape.order, -1]]
        ends = np.sort(corner[:, [[0, 2], [1, 3], [0, 1], [2, 3]]], axis=2)
        return ends @ [len(shape.points), 1]

    own, swept, sides = edges(facets), rows @ [6, 1], {}
    for name, others in shape.sides.items():
        if not np.isin(others @ [6, 1], swept).any():
            facet, edge = np.nonzero(np.isin(own, edges(shape.facet_nodes(others))))
            cell = facet + len(rows) * np.arange(layers)[:, None]
            if cell.size:
                sides[name] = _rows(cell, np.array(_LATERAL).ravel()[edge])
    return sides
