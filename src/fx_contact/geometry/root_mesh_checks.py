"""Validation of a RootMesh: array shapes, orientation of the cells, conformity, names.  Local."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Literal, TypeVar

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fx_contact.geometry import hexahedron
from fx_contact.geometry.hexahedral_mesh import HexahedralMesh
from fx_contact.parallel.arrays import Int64Array
from fx_contact.parallel.errors import GeometryError, SceneError
from fx_contact.parallel.validation import check_label, shown

Scalar = TypeVar("Scalar", bound=np.generic)

#: Highest order of cell maps.
MAX_ORDER = 6
#: Most root cells, for which the keys of `geometry.lattice` have room.
MOST_CELLS = 250_000
#: Smallest size, and inverse of the largest one, with volumes and inertias in double precision [m].
SMALLEST = 1e-60


def check_mesh(mesh: HexahedralMesh) -> None:
    """Raises GeometryError or SceneError, as `RootMesh`, unless a mesh, after `take_arrays`, can be refined."""
    _check_shapes(mesh)
    _check_jacobian(mesh)
    _check_conforming(mesh)
    _check_tags(mesh)


def take_arrays(mesh: HexahedralMesh) -> None:
    """Convert the arguments of a RootMesh to frozen arrays, tuples and dicts.  Raises GeometryError if that fails."""
    try:
        taken = {
            "points": _frozen(mesh.points, np.float64),
            "cells": _frozen(mesh.cells, np.int64),
            "bodies": tuple(mesh.bodies),
            "body": _frozen(mesh.body, np.int32),
            "surfaces": _named(mesh.surfaces, np.int32),
            "vertices": _named(mesh.vertices, np.int64),
            "curves": _named(mesh.curves, np.int32),
            "parts": _named(mesh.parts, np.int64),
        }
    except (TypeError, ValueError) as error:
        raise GeometryError(
            "points must be an array of numbers, cells and body of whole numbers, bodies a tuple of names, and "
            f"surfaces, vertices, curves and parts dicts of names and arrays of whole numbers: {error}"
        ) from error
    for name, value in taken.items():
        object.__setattr__(mesh, name, value)


def _frozen(value: Any, dtype: type[Scalar]) -> npt.NDArray[Scalar]:
    """A read-only array, a copy unless it is one already.  Raises TypeError for numbers of another kind."""
    array = np.asarray(value)
    casting: Literal["same_kind", "unsafe"] = "same_kind" if array.size else "unsafe"  # an empty list has no kind
    array = array.astype(dtype, casting=casting, copy=array.flags.writeable or array.base is not None)
    array.setflags(write=False)
    return array


def _named(groups: Mapping[str, Any], dtype: type[Scalar]) -> Mapping[str, npt.NDArray[Scalar]]:
    return MappingProxyType({name: _frozen(rows, dtype) for name, rows in dict(groups).items()})


def _check_shapes(mesh: HexahedralMesh) -> None:
    if mesh.points.ndim != 2 or mesh.points.shape[1] != 3:
        raise GeometryError(f"points must be a (npoints, 3) array, got shape {mesh.points.shape}")
    if not np.isfinite(mesh.points).all():
        node = int(np.argmin(np.isfinite(mesh.points).all(axis=1)))
        raise GeometryError(f"points must be finite, node {node} is at {mesh.points[node]}")
    complete = [(order + 1) ** 3 for order in range(1, MAX_ORDER + 1)]
    if mesh.cells.ndim != 2 or not mesh.cells.size or mesh.cells.shape[1] not in complete:
        raise GeometryError(
            f"cells must be a (ncells, (p+1)^3) array, complete hexahedra of order 1 to {MAX_ORDER}, got shape "
            f"{mesh.cells.shape}"
        )
    if mesh.body.shape != (len(mesh.cells),):
        raise GeometryError(f"body must have one number for each cell, got an array of shape {mesh.body.shape}")
    if mesh.cells.min() < 0 or mesh.cells.max() >= len(mesh.points):
        raise GeometryError(f"cells name nodes outside 0..{len(mesh.points) - 1}")
    stray = np.setdiff1d(np.arange(len(mesh.points)), mesh.cells)
    if len(stray):
        raise GeometryError(
            f"nodes that belong to no cell: {len(stray)}, as node {stray[0]} at {mesh.points[stray[0]]}; leave them out"
        )
    size = np.ptp(mesh.points, axis=0).max(initial=0.0)
    if not SMALLEST < size < 1 / SMALLEST:
        raise GeometryError(f"the root mesh is {size:.3g} large, its volumes are no numbers: check the units")


def _check_jacobian(mesh: HexahedralMesh) -> None:
    """The determinant of the cell map must be positive on a lattice finer than the nodes."""
    x = np.linspace(0, 1, 2 * mesh.order + 1)
    value, slope = hexahedron.lagrange(mesh.order, x), hexahedron.lagrange_derivative(mesh.order, x)
    gradient = [slope, value, value], [value, slope, value], [value, value, slope]
    smallest = np.empty(len(mesh.cells))
    step = 1 + 50_000 // len(x) ** 3  # cells at once, so that they fit into the processor's cache
    for start in range(0, len(mesh.cells), step):
        nodal = mesh.points[mesh.cells[start : start + step]]
        columns = [hexahedron.tensor_evaluate(functions, nodal) for functions in gradient]
        determinant = np.linalg.det(np.stack(columns, axis=-1))
        smallest[start : start + step] = determinant.min(axis=1) / np.maximum(np.abs(determinant).max(axis=1), 1e-300)
    if smallest.min() <= 1e-8:  # square root of the rounding unit; a degenerate corner is exactly 0 without rounding
        cell = int(smallest.argmin())
        raise GeometryError(
            f"root cell {cell} of {len(mesh.cells)} is inverted or degenerate: the smallest Jacobian determinant is "
            f"{smallest[cell]:.2g} times the largest, near {mesh.points[mesh.cells[cell]].mean(axis=0)}; "
            "check the node order (tensor order, x fastest) and the shape of the block"
        )


def _check_conforming(mesh: HexahedralMesh) -> None:
    _, kind, count = np.unique(np.sort(mesh.corners, axis=1), axis=0, return_inverse=True, return_counts=True)
    twice = np.flatnonzero(count[kind.ravel()] > 1)
    if len(twice):
        raise GeometryError(f"root cell {twice[0]} is there twice, or another cell has the same corners")
    if mesh.face_neighbours.max() > 2:
        cell, face = np.argwhere(mesh.face_neighbours > 2)[0]
        raise GeometryError(f"more than two cells share face {face} of root cell {cell}")
    nodes = np.sort(mesh.cells[:, hexahedron.face_nodes(mesh.order)], axis=2).reshape(mesh.faces.size, -1)
    one, other = nodes[mesh.common_faces.T]
    differ = (one != other).any(axis=1)
    if differ.any():
        first, second = mesh.common_faces[differ][0] // 6
        raise GeometryError(f"root cells {first} and {second} share the corners of a face but not its inner nodes")
    exterior = np.argwhere(mesh.face_neighbours == 1)
    for index, name in enumerate(mesh.bodies):
        _check_no_crack(mesh, name, exterior[mesh.body[exterior[:, 0]] == index])


def _check_no_crack(mesh: HexahedralMesh, name: str, facets: npt.NDArray[np.int64]) -> None:
    """No corner of a body's boundary may lie on a facet of the same body without being one of its nodes."""
    if not len(facets):
        return
    own = mesh.corners[facets[:, :1], hexahedron.FACE_CORNERS[facets[:, 1]]]
    corners = np.unique(own)
    positions = mesh.points[corners]
    size = np.ptp(positions, axis=0).max()
    lattice = mesh.facet_points(facets, order=2).reshape(-1, 3)
    distance, nearest = cKDTree(positions).query(lattice, distance_upper_bound=1e-9 * size)
    hit = np.flatnonzero(np.isfinite(distance))
    facet, found = hit // 9, corners[nearest[hit]]
    stray = (own[facet] != found[:, None]).all(axis=1)
    if stray.any():
        cell, face = facets[facet[stray][0]]
        raise GeometryError(
            f"body {name!r} does not hold together near {mesh.points[found[stray][0]]}: a corner of another cell lies "
            f"on face {face} of root cell {cell} without being one of its nodes; merge the duplicate nodes, or make "
            "the two blocks match"
        )


def _check_tags(mesh: HexahedralMesh) -> None:
    _check_bodies(mesh)
    names = [*mesh.surfaces, *mesh.curves, *mesh.vertices]
    for name in (*mesh.bodies, *mesh.parts, *names):
        check_label("a body, part, surface, curve or vertex", name)
    _check_parts(mesh)
    if len(set(names)) < len(names):
        raise SceneError(f"two surfaces, curves or vertices have one name, among {names}")
    for groups, kind, count in ((mesh.surfaces, "face", 6), (mesh.curves, "edge", 12)):
        for name, rows in groups.items():
            if rows.ndim and not len(rows):
                raise SceneError(f"{name!r} has no {kind} of a root cell: nothing in the mesh has its tag")
            good = rows.ndim == 2 and rows.shape[1] == 2 and len(np.unique(rows, axis=0)) == len(rows) > 0
            if not good or (rows < 0).any() or (rows >= (len(mesh.cells), count)).any():
                raise SceneError(
                    f"{name!r} must have at least one row (root cell, local {kind} 0..{count - 1}), none twice, of "
                    f"{len(mesh.cells)} root cells"
                )
    for name, facets in mesh.surfaces.items():
        inner = mesh.face_neighbours[facets[:, 0], facets[:, 1]] != 1
        if inner.any():
            cell, face = facets[inner][0]
            raise SceneError(f"surface {name!r} has face {face} of root cell {cell}, which is inside a body")
    for name, nodes in mesh.vertices.items():
        if nodes.ndim != 1 or not len(nodes) or not np.isin(nodes, mesh.corners).all():
            raise SceneError(f"vertex {name!r} is not a corner of root cells")


def _check_bodies(mesh: HexahedralMesh) -> None:
    numbers = np.unique(mesh.body)
    if len(set(mesh.bodies)) < len(mesh.bodies) or not np.array_equal(numbers, np.arange(len(mesh.bodies))):
        raise SceneError(
            f"bodies must have different names, and each of them cells: got {mesh.bodies} for the numbers {numbers}"
        )
    owner = np.full(len(mesh.points), -1)
    owner[mesh.cells] = mesh.body[:, None]
    common = owner[mesh.cells] != mesh.body[:, None]
    if common.any():
        cell, node = np.argwhere(common)[0]
        node = mesh.cells[cell, node]
        raise SceneError(
            f"bodies {mesh.bodies[mesh.body[cell]]!r} and {mesh.bodies[owner[node]]!r} share the node at "
            f"{mesh.points[node]}: bodies meet by contact only: cut them apart (`split=True` of meshes from "
            "dolfinx or Gmsh), or make them parts of one body"
        )
    body = _in_pieces(mesh, mesh.corners)
    if body is not None:
        raise SceneError(f"body {mesh.bodies[body]!r} falls into separate parts: give each part a name of its own")
    body = _in_pieces(mesh, mesh.faces)
    if body is not None:
        raise GeometryError(
            f"body {mesh.bodies[body]!r} falls into parts that have nodes in common, but no face of a cell: where they "
            "touch, their cells must have the same faces"
        )


def _in_pieces(mesh: HexahedralMesh, joints: Int64Array) -> int | None:
    """A body whose cells are not connected by common numbers (ncells, n) of their corners or faces; None: no body."""
    count = len(mesh.cells)
    rows, size = np.repeat(np.arange(count), joints.shape[1]), count + int(joints.max()) + 1
    graph = coo_matrix((np.ones(len(rows)), (rows, count + joints.ravel())), shape=(size, size))
    _, part = connected_components(graph, directed=False)
    parts = np.unique(np.stack([mesh.body, part[:count]]), axis=1)
    return int(np.bincount(parts[0]).argmax()) if len(parts[0]) > len(mesh.bodies) else None


def _check_parts(mesh: HexahedralMesh) -> None:
    seen = np.zeros(len(mesh.cells), dtype=bool)
    for name, cells in mesh.parts.items():
        good = cells.ndim == 1 and len(np.unique(cells)) == len(cells) > 0
        if not good or cells.min() < 0 or cells.max() >= len(mesh.cells):
            raise SceneError(
                f"part {name!r} must be at least one of {len(mesh.cells)} root cells, none twice, got {shown(cells)}"
            )
        if name in mesh.bodies:
            raise SceneError(
                f"a part and a body have the name {name!r}: cells in no part are known by that of the body"
            )
        if seen[cells].any():
            raise SceneError(f"root cell {cells[seen[cells]][0]} is in part {name!r} and in another one")
        of = np.unique(mesh.body[cells])
        if len(of) > 1:
            raise SceneError(
                f"part {name!r} has cells of bodies {mesh.bodies[of[0]]!r} and {mesh.bodies[of[1]]!r}: give each body "
                "parts of its own"
            )
        seen[cells] = True
