"""Mesh of curved hexahedra with names: numbering of faces and edges, positions, normals.  All is local.

The geometry of every leaf is the restriction of its root cell's map of order p, so refinement never changes the domain
(super-parametric elements, section 2 of the paper).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from fx_contact.geometry import hexahedron
from fx_contact.parallel.arrays import FloatArray, Int32Array, Int64Array, IntArray
from fx_contact.parallel.validation import check_name

#: Lattices evaluated at once, so that they fit into the processor's cache.
_CHUNK = 1 << 12
#: Largest distance from a plane, relative to the size of the surface: rounding by the mesh generator.
PLANE = 1e-6
#: Between the names of surfaces in that of their union.
UNION = " + "
#: Order of the lattice of sampling points in a root cell.
_SAMPLES = 5


@dataclass(frozen=True, eq=False, repr=False)
class Hexahedra:
    """Curved hexahedra: points (npoints, 3), and nodes of cells (ncells, (p+1)^3) in tensor order, x fastest."""

    points: FloatArray
    cells: Int64Array

    @cached_property
    def order(self) -> int:
        """Polynomial order p of the cell maps."""
        return hexahedron.order_of(self.cells.shape[1])

    @cached_property
    def corners(self) -> Int64Array:
        """(ncells, 8), nodes at the cell corners, tensor order."""
        return self.cells[:, hexahedron.corner_nodes(self.order)]

    @cached_property
    def faces(self) -> Int64Array:
        """(ncells, 6), number of each local face in the mesh."""
        corners = np.sort(self.corners[:, hexahedron.FACE_CORNERS], axis=2).reshape(-1, 4)
        return np.unique(corners, axis=0, return_inverse=True)[1].reshape(-1, 6)

    @cached_property
    def face_neighbours(self) -> Int64Array:
        """(ncells, 6), number of cells that share each local face (1: exterior)."""
        return np.bincount(self.faces.ravel())[self.faces]

    @cached_property
    def common_faces(self) -> Int64Array:
        """(n, 2), 6 times the cell plus the local face of both sides of each inner face, the lower cell first."""
        order = np.argsort(self.faces, axis=None, kind="stable")
        return np.stack([order[:-1], order[1:]], axis=1)[np.diff(self.faces.flat[order]) == 0]

    def facet_nodes(self, facets: IntArray) -> Int64Array:
        """Nodes (n, (p+1)^2), first tangent fastest, of facets (n, 2) as (cell, local face)."""
        return self.cells[facets[:, :1], hexahedron.face_nodes(self.order)[facets[:, 1]]]


@dataclass(frozen=True, eq=False, repr=False)
class HexahedralMesh(Hexahedra):
    """Curved hexahedra of order 1 to 6, and names of them, which `RootMesh` describes and checks."""

    bodies: tuple[str, ...]
    body: Int32Array
    surfaces: Mapping[str, Int32Array] = field(default_factory=dict)
    vertices: Mapping[str, Int64Array] = field(default_factory=dict)
    curves: Mapping[str, Int32Array] = field(default_factory=dict)
    parts: Mapping[str, Int64Array] = field(default_factory=dict)

    @cached_property
    def regions(self) -> tuple[str, ...]:
        """Names of what has a material: bodies, except for those that consist of parts alone, then parts."""
        return (*(self.bodies[body] for body in np.unique(self.body[self._part < 0])), *self.parts)

    @cached_property
    def region(self) -> Int32Array:
        """(ncells,), index into `regions`: the part of each cell, else its body."""
        rest, part = np.unique(self.body[self._part < 0]), self._part
        return np.where(part < 0, np.searchsorted(rest, self.body), len(rest) + part).astype(np.int32)

    @cached_property
    def body_of_region(self) -> Int32Array:
        """(nregions,), index into `bodies`."""
        return self.body[np.unique(self.region, return_index=True)[1]]

    @cached_property
    def _part(self) -> Int64Array:
        """(ncells,), index into `parts`, -1: in none."""
        part = np.full(len(self.cells), -1)
        for index, cells in enumerate(self.parts.values()):
            part[cells] = index
        return part

    @cached_property
    def edges(self) -> Int64Array:
        """(ncells, 12), number of each local edge in the mesh."""
        ends = np.sort(self.corners[:, hexahedron.EDGE_CORNERS], axis=2).reshape(-1, 2)
        return np.unique(ends, axis=0, return_inverse=True)[1].reshape(-1, 12)

    def cells_of(self, name: str) -> Int64Array:
        """Cells (n,) of a body with its parts, or of a part.  Raises SceneError if there is no such body or part."""
        check_name("body or part", name, [*self.bodies, *self.parts], "the root mesh has")
        return self.parts[name] if name in self.parts else np.flatnonzero(self.body == self.bodies.index(name))

    def surface(self, name: str) -> Int32Array:
        """Facets (n, 2) of a surface, or of a union "a + b" of surfaces, as (root cell, local face).

        Raises SceneError if there is no such surface.
        """
        if self._is_union(name):
            return np.unique(np.concatenate([self.surface(part) for part in name.split(UNION)]), axis=0)
        check_name("surface", name, self.surfaces, "the root mesh has")
        return self.surfaces[name]

    def _is_union(self, name: str) -> bool:
        return isinstance(name, str) and UNION in name and name not in self.surfaces

    def nodes_of(self, name: str) -> Int64Array:
        """Corner nodes (n,) of a surface, curve or vertex.  Raises SceneError if there is no such place."""
        known = [*self.surfaces, *self.curves, *self.vertices]
        if self._is_union(name) and name not in known:
            return np.unique(self.corners[:, hexahedron.FACE_CORNERS][tuple(self.surface(name).T)])
        check_name("surface, curve or vertex", name, known, "the root mesh has")
        for groups, corners in ((self.surfaces, hexahedron.FACE_CORNERS), (self.curves, hexahedron.EDGE_CORNERS)):
            if name in groups:
                cell, entity = groups[name].T
                return np.unique(self.corners[cell[:, None], corners[entity]])
        return self.vertices[name]

    def samples(self, name: str) -> FloatArray:
        """Sampling points (n, 3) [m] of a surface, curve, vertex, body or part, for functions of position."""
        if name in self.surfaces or self._is_union(name):
            return self.facet_points(self.surface(name), _SAMPLES).reshape(-1, 3)
        if name in self.curves:
            cells, edges = self.curves[name].T
            nodes = hexahedron.edge_nodes(_SAMPLES)[edges]
        elif name in (*self.bodies, *self.parts):
            cells = self.cells_of(name)
            nodes = np.arange((_SAMPLES + 1) ** 3)[None]
        else:
            return self.points[self.nodes_of(name)]
        points = self.evaluate(cells, np.tile(np.linspace(0, 1, _SAMPLES + 1), (len(cells), 3, 1)))
        return np.take_along_axis(points, nodes[:, :, None], axis=1).reshape(-1, 3)

    def facet_points(self, facets: IntArray, order: int | None = None) -> FloatArray:
        """Lattice points (n, (order+1)^2, 3) [m], by default nodes, of facets (n, 2), first tangent fastest."""
        order = order or self.order
        functions = hexahedron.lagrange(self.order, np.linspace(0, 1, order + 1))
        values = hexahedron.tensor_evaluate((functions,) * 3, self.points[self.cells[facets[:, 0]]])
        return np.take_along_axis(values, hexahedron.face_nodes(order)[facets[:, 1]][:, :, None], axis=1)

    def middle(self, facets: IntArray) -> FloatArray:
        """Middle (3,) of the first of some facets (n, 2) [m].  Local."""
        return np.asarray(self.facet_points(facets[:1]).mean(axis=(0, 1)))

    def outward_normals(self, facets: IntArray) -> FloatArray:
        """Mean outward unit normals (n, 3) [-] of facets (n, 2) as (root cell, local face)."""
        normal = hexahedron.area_vectors(self.facet_points(facets, order=1))
        normal *= hexahedron.FACE_ORIENTATION[facets[:, 1]][:, None]
        return normal / np.linalg.norm(normal, axis=1)[:, None]

    def facet_areas(self, facets: IntArray) -> FloatArray:
        """Areas (n,) [m^2] of the quadrilaterals of the corners of facets (n, 2), along their mean plane."""
        return np.asarray(np.linalg.norm(hexahedron.area_vectors(self.facet_points(facets, order=1)), axis=1))

    def evaluate(self, cells: IntArray, coordinates: FloatArray) -> FloatArray:
        """Positions (n, m^3, 3) [m] of tensor lattices in root cells (n,), x fastest.

        The reference coordinates (n, 3, m) along each axis are in [0, 1].
        """
        m = coordinates.shape[2]
        result = np.empty((len(cells), m**3, 3))
        for start in range(0, len(cells), _CHUNK):
            part = slice(start, start + _CHUNK)
            result[part] = self._evaluate(cells[part], coordinates[part])
        return result

    def _evaluate(self, cells: IntArray, coordinates: FloatArray) -> FloatArray:
        """Evaluation of few lattices at once; those in one root cell with equal z, or z and y, share work."""
        n, k, m = len(cells), self.order + 1, coordinates.shape[2]
        layer, of_layer = _distinct(cells, coordinates[:, 2])
        column, of_column = _distinct(of_layer, coordinates[:, 1])
        fx = hexahedron.lagrange(self.order, coordinates[:, 0])
        fy = hexahedron.lagrange(self.order, coordinates[column, 1])
        fz = hexahedron.lagrange(self.order, coordinates[layer, 2])
        nodal = self.points[self.cells[cells[layer]]].reshape(len(layer), k * k, k, 3).swapaxes(2, 3)  # x last
        values = fz @ nodal.reshape(len(layer), k, k * k * 3)
        values = fy[:, None] @ values.reshape(len(layer), m, k, k * 3)[of_layer[column]]
        values = values.reshape(len(column), m * m * 3, k)[of_column] @ fx.swapaxes(1, 2)
        return values.reshape(n, m * m, 3, m).swapaxes(2, 3).reshape(n, m**3, 3)


def _distinct(number: IntArray, coordinates: FloatArray) -> tuple[Int64Array, Int64Array]:
    """First rows (k,) of the distinct pairs (number, coordinates), and the position (n,) of each row among them."""
    order = np.lexsort((*coordinates.T, number))
    number, coordinates = number[order], coordinates[order]
    new = np.ones(len(order), dtype=bool)
    new[1:] = (number[1:] != number[:-1]) | (coordinates[1:] != coordinates[:-1]).any(axis=1)
    which = np.empty(len(order), dtype=np.int64)
    which[order] = np.cumsum(new) - 1
    return order[new], which
