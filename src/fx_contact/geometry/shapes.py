"""Shapes: curved hexahedra with named sides, placed, joined and swept into the bodies of a RootMesh.

`geometry.solids` makes simple shapes, `geometry.swept_shapes` others from their sides.  Functions of position take an
array (3, n) of points.  All is local: every rank makes the same shapes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fx_contact.geometry import hexahedron
from fx_contact.geometry.hexahedral_mesh import Hexahedra
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int32Array, Int64Array
from fx_contact.parallel.errors import GeometryError, SceneError
from fx_contact.parallel.validation import as_tuple, check_degrees, check_label, check_name, check_vector, shown

#: A function of positions (3, n) that gives new positions: three arrays (n,), or numbers.
Placement: TypeAlias = Callable[[FloatArray], Sequence[npt.ArrayLike] | FloatArray]
#: A function of positions (3, n) that gives a truth value (n,) for each.
Predicate: TypeAlias = Callable[[FloatArray], BoolArray | np.bool_]
#: "x", "y" or "z", or the direction of an axis through the origin.
Axis: TypeAlias = str | Sequence[float] | FloatArray

AXES = ("x", "y", "z")
#: Distance within which nodes of joined shapes are merged, relative to the extent of all.
_SAME = 1e-9


@dataclass(frozen=True, eq=False)
class Shape(Hexahedra):
    """Hexahedra of one order with named sides; validated by `root_mesh_from_shapes`.

    Attributes:
        points: (npoints, 3), node positions, in the unit of the mesh.
        cells: (ncells, (p+1)^3), nodes of each cell in tensor order, x fastest, equispaced in the reference cell.
        sides: name -> (n, 2), facets (cell, local face) on the boundary.
        parts: name -> (n,), cells of a part, which may have a material of its own.
    """

    sides: dict[str, Int32Array] = field(default_factory=dict)
    parts: dict[str, Int64Array] = field(default_factory=dict)

    @cached_property
    def boundary(self) -> Int32Array:
        """(n, 2), all facets (cell, local face) of the boundary."""
        return np.argwhere(self.face_neighbours == 1).astype(np.int32)

    def side(self, name: str) -> Int32Array:
        """(n, 2), facets (cell, local face) of a side.  Raises SceneError if there is no side of that name."""
        check_name("side", name, self.sides, "the shape has")
        return self.sides[name]

    def named(self, name: str, *sides: str, where: Predicate | None = None) -> Shape:
        """The shape with one more side, the union of existing `sides` or the whole boundary.

        A side may be named anew among `sides`, or on the whole boundary.

        Args:
            where: predicate that all nodes of its facets satisfy; None: any.

        Raises:
            SceneError: an unknown side, a name that is none, or that of another side.
            GeometryError: no facet is there, or `where` is no function that gives truth values.
        """
        check_label("a side", name)
        if sides and name in self.sides and name not in sides:
            raise SceneError(f"the shape has a side {name!r} already; take another name, or give it among the sides")
        rows = np.unique(np.concatenate([self.side(side) for side in sides]), axis=0) if sides else self.boundary
        if where is not None:
            inside = _holds(name, where, self.points)
            rows = rows[inside[self.facet_nodes(rows)].all(axis=1)]
        if not len(rows):
            raise GeometryError(f"side {name!r} has no facet: none has all its nodes in the place that is asked for")
        return replace(self, sides={**self.sides, name: rows})

    def as_part(self, name: str, where: Predicate | None = None) -> Shape:
        """The shape, or those of its cells whose nodes all satisfy a predicate, as a part with a name.

        A cell is in one part, that which is named last.  Raises SceneError for a name that is none, GeometryError if no
        cell is there, or `where` is no function that gives truth values.
        """
        check_label("a part", name)
        inside = np.ones(len(self.points), dtype=bool) if where is None else _holds(name, where, self.points)
        cells = np.flatnonzero(inside[self.cells].all(axis=1))
        if not len(cells):
            raise GeometryError(f"part {name!r} has no cell: none has all its nodes in the place that is asked for")
        others = {other: np.setdiff1d(rows, cells) for other, rows in self.parts.items()}
        return replace(self, parts={other: rows for other, rows in others.items() if len(rows)} | {name: cells})

    def placed(self, place: Placement) -> Shape:
        """The shape with its nodes moved by a function.  Raises GeometryError unless it gives positions."""
        return replace(self, points=images("the place of a shape", place, self.points))

    def shifted(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Shape:
        """The shape moved by x, y, z, in the unit of the mesh.  Raises SceneError unless these are numbers."""
        return replace(self, points=self.points + np.array(check_vector("the shift x, y or z", (x, y, z))))

    def turned(self, axis: Axis, degrees: float) -> Shape:
        """The shape turned about an axis, counter-clockwise from its tip.

        Raises SceneError for no axis or an angle that is no number, GeometryError for an axis of length zero.
        """
        return replace(self, points=self.points @ rotation(axis, check_degrees("an angle", degrees)).T)

    def mirrored(self, axis: str) -> Shape:
        """The shape mirrored across "x", "y" or "z" at the origin.  Raises SceneError for another axis."""
        check_name("axis", axis, AXES)
        nodes = hexahedron.grid_points(self.order) @ [-1, self.order + 1, (self.order + 1) ** 2] + self.order
        faces = np.arange(6)
        faces[hexahedron.FACES[0]] = hexahedron.FACES[0, ::-1]
        return replace(
            self,
            points=self.points * np.where(np.arange(3) == AXES.index(axis), -1.0, 1.0),
            cells=self.cells[:, nodes],  # reversed along x, since a reflection inverts cells
            sides={name: np.stack([rows[:, 0], faces[rows[:, 1]]], axis=1) for name, rows in self.sides.items()},
        )


def join(*shapes: Shape | Sequence[Shape]) -> Shape:
    """One shape made of several of one order that touch, or of a list of them, or of one whose ends meet.

    Coincident nodes are merged, sides and parts of one name are united, and facets shared by two cells belong to no
    side.  Raises SceneError for something else than shapes, GeometryError for different orders, or no shape at all.
    """
    pieces = as_tuple("what is joined", shapes[0] if len(shapes) == 1 else shapes, Shape)
    if len({shape.order for shape in pieces}) != 1:
        raise GeometryError(f"shapes of one order can be joined, got orders {[shape.order for shape in pieces]}")
    beside = _side_by_side([("", shape) for shape in pieces])
    near = cKDTree(beside.points).query_pairs(_SAME * np.ptp(beside.points, axis=0).max(), output_type="ndarray")
    graph = coo_matrix((np.ones(len(near)), near.T), shape=(len(beside.points),) * 2)
    _, place = connected_components(graph, directed=False)
    _, kept = np.unique(place, return_index=True)
    whole = replace(beside, points=beside.points[kept], cells=place[beside.cells].astype(np.int64))
    outside = whole.boundary @ [6, 1]
    sides = {name: rows[np.isin(rows @ [6, 1], outside)] for name, rows in whole.sides.items()}
    return replace(whole, sides={name: rows for name, rows in sides.items() if len(rows)})


def _side_by_side(shapes: Sequence[tuple[str, Shape]]) -> Shape:
    """Shapes, whose sides and parts have a prefix, as one that does not hold together; those of one name are united."""
    cells, sides, parts = [], dict[str, list[Int32Array]](), dict[str, list[Int64Array]]()
    node = cell = 0
    for prefix, shape in shapes:
        for name, facets in shape.sides.items():
            sides.setdefault(prefix + name, []).append(facets + np.array([cell, 0], np.int32))
        for name, rows in shape.parts.items():
            parts.setdefault(prefix + name, []).append(rows + cell)
        cells.append(shape.cells + node)
        node, cell = node + len(shape.points), cell + len(shape.cells)
    return Shape(
        np.concatenate([shape.points for _, shape in shapes]),
        np.concatenate(cells),
        {name: np.concatenate(every) for name, every in sides.items()},
        {name: np.concatenate(each) for name, each in parts.items()},
    )


def root_mesh_from_shapes(
    bodies: Mapping[str, Shape],
    surfaces: Mapping[str, str | Sequence[str]] | None = None,
    curves: Mapping[str, tuple[str, Predicate]] | None = None,
    vertices: Mapping[str, tuple[str, Predicate]] | None = None,
) -> RootMesh:
    """Root mesh of bodies given by shapes, whose parts are called "BODY PART".

    Args:
        surfaces: name -> "BODY SIDE", or a list of several: surfaces beside each side of each body, named so.
        curves, vertices: name -> (body, predicate): the cell edges whose nodes all satisfy the predicate, or the cell
            corners that do.

    Raises:
        SceneError: an unknown body or side, surfaces, curves or vertices of another form, or as `RootMesh`.
        GeometryError: bodies that are no shapes or of different orders, a place without edges or corners, a predicate
            without truth values, or as `RootMesh`.
    """
    for what, given in (("surfaces", surfaces), ("curves", curves), ("vertices", vertices)):
        if not isinstance(given, Mapping | None):
            raise SceneError(f"{what} must be a dict by name, got {shown(given)}")
    shapes = list(bodies.values()) if isinstance(bodies, Mapping) else []
    if not shapes or not all(isinstance(shape, Shape) for shape in shapes):
        raise GeometryError(f"bodies must be a dict of at least one name and Shape, got {shown(bodies)}")
    if len({shape.order for shape in shapes}) > 1:
        orders = ", ".join(f"{name!r} of order {shape.order}" for name, shape in bodies.items())
        raise GeometryError(f"bodies must be of one order, got {orders}")
    whole = _side_by_side([(f"{name} ", shape) for name, shape in bodies.items()])
    body = np.repeat(np.arange(len(bodies)), [len(shape.cells) for shape in shapes])
    known = whole.sides | _united(whole.sides, surfaces or {})

    def found(places: Mapping[str, tuple[str, Predicate]] | None, local: Int64Array) -> dict[str, Int32Array]:
        """Rows (cell, local edge or corner) of each place, each edge or corner once.

        Raises:
            SceneError: an unknown body.
            GeometryError: a place without edges or corners, or a predicate without truth values.
        """
        result = {}
        for name, given in (places or {}).items():
            if not isinstance(given, (tuple, list)) or len(given) != 2:
                raise SceneError(f"{name!r} must be given as (body, function of positions), got {shown(given)}")
            where, place = given
            check_name("body", where, bodies)
            nodes = whole.cells[:, local]
            inside = _holds(name, place, whole.points)[nodes].all(axis=2)
            there = inside & (body == list(bodies).index(where))[:, None]
            rows = np.argwhere(there).astype(np.int32)
            if not len(rows):
                raise GeometryError(f"{name!r} has no edge or corner of a cell of body {where!r}")
            result[name] = rows[np.unique(nodes[there][:, [0, -1]], axis=0, return_index=True)[1]]
        return result

    corners = found(vertices, hexahedron.corner_nodes(whole.order)[:, None])
    nodes = {name: whole.corners[tuple(rows.T)] for name, rows in corners.items()}
    edges = found(curves, hexahedron.edge_nodes(whole.order))
    return RootMesh(whole.points, whole.cells, tuple(bodies), body, known, nodes, edges, whole.parts)


def _united(sides: dict[str, Int32Array], surfaces: Mapping[str, str | Sequence[str]]) -> dict[str, Int32Array]:
    """Facets of surfaces by the names of their sides.  Raises SceneError: no list of names, or an unknown side."""
    parts = {name: as_tuple(f"the sides of surface {name!r}", part, str) for name, part in surfaces.items()}
    for part in parts.values():
        for side in part:
            check_name("side", side, sides, "the bodies have")
    return {name: np.unique(np.concatenate([sides[side] for side in part]), axis=0) for name, part in parts.items()}


def images(what: str, place: Placement, points: FloatArray) -> FloatArray:
    """Images (n, 3) of points (n, 3).  Raises GeometryError unless they are positions that a function gives."""
    image = place(points.T.copy()) if callable(place) else place
    result: FloatArray
    try:
        result = np.stack(np.broadcast_arrays(*image, np.empty(len(points)))[:-1], axis=1).astype(np.float64)
    except (TypeError, ValueError):
        result = np.empty((0, 0))
    if not callable(place) or result.shape != points.shape or not np.isfinite(result).all():
        raise GeometryError(
            f"{what} must be a function of points of shape {points.T.shape} that gives finite x, y and z, got "
            f"{shown(image)}"
        )
    return result


def _holds(name: str, where: Predicate, points: FloatArray) -> BoolArray:
    """Values (n,) of a user's predicate; GeometryError unless they are truth values."""
    try:
        inside = np.asarray(where(points.T.copy()) if callable(where) else where)
    except (TypeError, ValueError) as error:
        raise GeometryError(
            f"the place of {name!r} must be a function of one array (3, n) of positions, which joins conditions by & "
            f"and |: {error}"
        ) from error
    if not callable(where) or inside.shape != (len(points),) or inside.dtype != bool:
        raise GeometryError(
            f"the place of {name!r} must be a function that gives a truth value for each of {len(points)} points, "
            f"got {shown(inside)}"
        )
    return inside


def rotation(axis: Axis, degrees: float) -> FloatArray:
    """Rotation matrix (3, 3), exact for right angles.  Raises SceneError for no axis, GeometryError for a zero one."""
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
