"""Shapes: curved hexahedra with named sides, placed, joined and swept until they are the bodies of a RootMesh.

Simple shapes are made in `problem.solids`, others by `problem.swept_shapes` from a side of these.  Functions of
position take an array (3, n) of points, as those of conditions do.  All functions here are local: every rank makes the
same.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fx_contact.parallel.errors import GeometryError
from fx_contact.parallel.validation import check_name, check_number, check_vector, shown
from fx_contact.problem import hexahedron
from fx_contact.problem.root_mesh import RootMesh

AXES = ("x", "y", "z")
#: Nodes of shapes that are joined are one if they are closer than this, over the extent of all.
_SAME = 1e-9


@dataclass(frozen=True, eq=False)
class Shape:
    """Hexahedra of one order; it is checked when it becomes a body of a RootMesh (`root_mesh_from_shapes`).

    Attributes:
        points: (npoints, 3) float64, node positions, in the unit of the mesh.
        cells: (ncells, (p+1)^3) int64, nodes of each cell in tensor order, x fastest, equispaced in the reference cell.
        sides: name -> (n, 2) int32 rows (cell, local face) on the boundary.
    """

    points: np.ndarray
    cells: np.ndarray
    sides: dict[str, np.ndarray] = field(default_factory=dict)

    @cached_property
    def order(self):
        """Polynomial order p of the cell maps."""
        return hexahedron.order_of(self.cells.shape[1])

    @cached_property
    def boundary(self):
        """(n, 2) int32 rows (cell, local face) of all facets of the boundary."""
        corners = self.cells[:, hexahedron.corner_nodes(self.order)][:, hexahedron.FACE_CORNERS]
        number = np.unique(np.sort(corners, axis=2).reshape(-1, 4), axis=0, return_inverse=True)[1].ravel()
        alone = np.bincount(number)[number] == 1
        return np.argwhere(alone.reshape(-1, 6)).astype(np.int32)

    def side(self, name):
        """(n, 2) int32 rows (cell, local face) of a side.  Raises SceneError where there is none of that name."""
        check_name("side", name, self.sides, "the shape has")
        return self.sides[name]

    def named(self, name, *sides, where=None):
        """The shape with one more side.

        Args:
            name: of the new side.
            sides: names of those that it is made of; none: the whole boundary.
            where: function of positions (3, n) that gives (n,) bool; a facet belongs to the side if all its nodes do.
                None: everywhere.

        Returns:
            Shape.

        Raises:
            SceneError: an unknown side.
            GeometryError: no facet is there, or the function gives something else.
        """
        rows = np.unique(np.concatenate([self.side(side) for side in sides]), axis=0) if sides else self.boundary
        if where is not None:
            inside = _holds(name, where, self.points)
            rows = rows[inside[self.facet_nodes(rows)].all(axis=1)]
        if not len(rows):
            raise GeometryError(f"side {name!r} has no facet: none has all its nodes in the place that is asked for")
        return replace(self, sides={**self.sides, name: rows})

    def placed(self, place):
        """The shape with its nodes elsewhere.

        Args:
            place: function of positions (3, n) that gives the new ones: three arrays (n,), or numbers.

        Returns:
            Shape.

        Raises:
            GeometryError: the function gives something else.
        """
        return replace(self, points=images("the place of a shape", place, self.points))

    def shifted(self, x=0.0, y=0.0, z=0.0):
        """The shape moved by x, y, z, in the unit of the mesh.  Raises SceneError for what are no numbers."""
        return replace(self, points=self.points + [check_number("the shift x, y or z", v) for v in (x, y, z)])

    def turned(self, axis, degrees):
        """The shape turned about an axis through the origin.

        Args:
            axis: "x", "y" or "z", or three numbers: a direction.
            degrees: angle, counter-clockwise seen from the tip of the axis.

        Returns:
            Shape.

        Raises:
            SceneError: no axis, or no number.
            GeometryError: an axis without direction.
        """
        return replace(self, points=self.points @ rotation(axis, check_number("an angle", degrees)).T)

    def mirrored(self, axis):
        """The shape mirrored at a plane through the origin.

        Args:
            axis: "x", "y" or "z", across the plane.

        Returns:
            Shape.

        Raises:
            SceneError: another axis.
        """
        check_name("axis", axis, AXES)
        nodes = hexahedron.grid_points(self.order) @ [-1, self.order + 1, (self.order + 1) ** 2] + self.order
        faces = np.arange(6)
        faces[hexahedron.FACE_AXIS == 0] = faces[hexahedron.FACE_AXIS == 0][::-1]
        return replace(
            self,
            points=self.points * np.where(np.arange(3) == AXES.index(axis), -1.0, 1.0),
            cells=self.cells[:, nodes],  # the other way round along x, or they would be inverted
            sides={name: np.stack([rows[:, 0], faces[rows[:, 1]]], axis=1) for name, rows in self.sides.items()},
        )

    def facet_nodes(self, rows):
        """Nodes of facets, first tangent fastest: (n, (p+1)^2) int64.

        Args:
            rows: (n, 2) int (cell, local face).
        """
        return self.cells[rows[:, :1], hexahedron.face_nodes(self.order)[rows[:, 1]]]


def join(*shapes):
    """One shape of several that touch; or of one whose ends meet.

    Args:
        shapes: of one order.

    Returns:
        Shape.  Nodes at one place are one node, sides of one name one side, and facets that two cells share are in no
        side any more.

    Raises:
        GeometryError: different orders, or none at all.
    """
    if len({shape.order for shape in shapes}) != 1:
        raise GeometryError(f"shapes of one order can be joined, got orders {[shape.order for shape in shapes]}")
    points, cells, first = _concatenated(shapes)
    near = cKDTree(points).query_pairs(_SAME * np.ptp(points, axis=0).max(), output_type="ndarray")
    graph = coo_matrix((np.ones(len(near)), near.T), shape=(len(points),) * 2)
    _, place = connected_components(graph, directed=False)
    _, kept = np.unique(place, return_index=True)
    whole = Shape(points[kept], place[cells].astype(np.int64))
    names = dict.fromkeys(name for shape in shapes for name in shape.sides)
    outside, sides = whole.boundary @ [6, 1], {}
    for name in names:
        rows = [shape.sides[name] + [start, 0] for shape, start in zip(shapes, first) if name in shape.sides]
        rows = np.concatenate(rows).astype(np.int32)
        sides[name] = rows[np.isin(rows @ [6, 1], outside)]
    return replace(whole, sides={name: rows for name, rows in sides.items() if len(rows)})


def root_mesh_from_shapes(bodies, surfaces=None, curves=None, vertices=None):
    """The root mesh of some bodies.

    Args:
        bodies: name of a body -> Shape.
        surfaces: name -> "BODY SIDE", or a list of several; None: each side of each body, called so.
        curves, vertices: name -> (body, function of positions (3, n) that gives (n,) bool): the edges of cells all of
            whose nodes are there, or the corners of cells, for conditions along lines and at points.

    Returns:
        RootMesh.

    Raises:
        SceneError: an unknown body or side, or as `RootMesh`.
        GeometryError: shapes of different orders, a place without edges or corners, or as `RootMesh`.
    """
    if not bodies or not all(isinstance(shape, Shape) for shape in bodies.values()):
        raise GeometryError(f"bodies must be a dict of at least one name and Shape, got {shown(bodies)}")
    if len({shape.order for shape in bodies.values()}) > 1:
        orders = ", ".join(f"{name!r} of order {shape.order}" for name, shape in bodies.items())
        raise GeometryError(f"bodies must be of one order, got {orders}")
    points, cells, first = _concatenated(bodies.values())
    body = np.repeat(np.arange(len(bodies)), [len(shape.cells) for shape in bodies.values()])
    known = {
        f"{name} {side}": rows + np.array([start, 0], np.int32)
        for (name, shape), start in zip(bodies.items(), first)
        for side, rows in shape.sides.items()
    }
    if surfaces is not None:
        parts = {name: [part] if isinstance(part, str) else part for name, part in surfaces.items()}
        for part in sum(map(list, parts.values()), []):
            check_name("side", part, known, "the bodies have")
        known = {name: np.unique(np.concatenate([known[p] for p in part]), axis=0) for name, part in parts.items()}
    order = hexahedron.order_of(cells.shape[1])

    def found(places, local):
        """Name -> rows (cell, local edge or corner) of the places: each edge or corner once.

        Raises:
            SceneError: an unknown body.
            GeometryError: a place has none.
        """
        result = {}
        for name, (where, place) in (places or {}).items():
            check_name("body", where, bodies)
            nodes = cells[:, local]
            there = _holds(name, place, points)[nodes].all(axis=2) & (body == list(bodies).index(where))[:, None]
            rows = np.argwhere(there).astype(np.int32)
            if not len(rows):
                raise GeometryError(f"{name!r} has no edge or corner of a cell of body {where!r}")
            result[name] = rows[np.unique(nodes[there][:, [0, -1]], axis=0, return_index=True)[1]]
        return result

    corner = hexahedron.corner_nodes(order)
    return RootMesh(
        points,
        cells,
        tuple(bodies),
        body,
        known,
        {name: cells[rows[:, 0], corner[rows[:, 1]]] for name, rows in found(vertices, corner[:, None]).items()},
        found(curves, hexahedron.edge_nodes(order)),
    )


def _concatenated(shapes):
    """Points and cells of all shapes, and the number of the first cell of each."""
    shapes = list(shapes)
    nodes, cells = (np.cumsum([0, *(len(getattr(s, name)) for s in shapes)]) for name in ("points", "cells"))
    moved = [shape.cells + start for shape, start in zip(shapes, nodes)]
    return np.concatenate([shape.points for shape in shapes]), np.concatenate(moved), cells


def images(what, place, points):
    """Where a function of the user puts points.

    Args:
        what: it is, for the message.
        place: function of positions (3, n) that gives three arrays (n,), or numbers.
        points: (n, 3) float64 [m].

    Returns:
        (n, 3) float64 [m].

    Raises:
        GeometryError: it gives something else.
    """
    image = place(points.T.copy())
    try:
        result = np.stack(np.broadcast_arrays(*image, np.empty(len(points)))[:-1], axis=1).astype(np.float64)
    except (TypeError, ValueError):
        result = np.empty((0, 0))
    if result.shape != points.shape or not np.isfinite(result).all():
        raise GeometryError(
            f"{what} must be a function of points of shape {points.T.shape} that gives finite x, y and z, got "
            f"{shown(image)}"
        )
    return result


def _holds(name, where, points):
    """Where a user's predicate holds: (n,) bool; GeometryError where it gives something else."""
    inside = np.asarray(where(points.T.copy()))
    if inside.shape != (len(points),) or inside.dtype != bool:
        raise GeometryError(
            f"the place of {name!r} must be a function that gives a truth value for each of {len(points)} points, "
            f"got {shown(inside)}"
        )
    return inside


def rotation(axis, degrees):
    """A rotation about an axis through the origin, exact for right angles.

    Args:
        axis: "x", "y" or "z", or three numbers: a direction.
        degrees: angle, counter-clockwise seen from the tip of the axis.

    Returns:
        (3, 3) float64.

    Raises:
        SceneError: no axis.
        GeometryError: an axis without direction.
    """
    if isinstance(axis, str):
        check_name("axis", axis, AXES)
        axis = np.eye(3)[AXES.index(axis)]
    check_vector("an axis", axis)
    if not np.any(axis):
        raise GeometryError("an axis must have a direction, got zero")
    x, y, z = np.array(axis, np.float64) / np.linalg.norm(axis)
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    quarters, rest = divmod(degrees, 90)
    sine, cosine = np.sin(np.radians(rest)), np.cos(np.radians(rest))
    for _ in range(int(quarters) % 4):
        sine, cosine = cosine, -sine
    return np.eye(3) + sine * across + (1 - cosine) * across @ across  # Rodrigues
