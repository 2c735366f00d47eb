"""The dolfinx mesh of a forest with geometry of order q, and the map from its cells to the leaves.

Geometry nodes are shared by entity of the leaf mesh, as dolfinx requires on meshes with hanging nodes: the vertex of
a fine leaf and the middle node of a coarse edge at the same place are two nodes.
"""

from dataclasses import dataclass

import basix.ufl
import numpy as np
from basix import CellType, LagrangeVariant
from dolfinx.mesh import Mesh, create_mesh
from mpi4py import MPI

from fx_contact.forest.forest import Forest
from fx_contact.geometry import hexahedron
from fx_contact.geometry.lattice import MAX_LEVEL, SIDE, leaf_side
from fx_contact.parallel import compat
from fx_contact.parallel.arrays import FloatArray, Int32Array, Int64Array, IntArray
from fx_contact.surfaces.facet_pairing import leaf_code

#: Leaves whose positions are computed at once, so that they fit into the processor's cache.
_CHUNK = 1 << 13


@dataclass(frozen=True, eq=False)
class LeafMesh:
    """A dolfinx mesh whose cells are the leaves of this rank, without ghosts, with geometry of an order q.

    Attributes:
        leaf: (ncells,), this rank's leaf of each local cell.
    """

    mesh: Mesh
    order: int
    leaf: Int64Array

    @property
    def _cell(self) -> Int32Array:
        return np.argsort(self.leaf).astype(np.int32)

    def facets(self, forest: Forest, facets: IntArray) -> Int32Array:
        """Exterior facets (m, 2), (local cell, local facet), on root facets (k, 2), for dolfinx's integrals.

        Local.  Hanging facets, which are exterior ones for dolfinx, are not among them.
        """
        leaf, face = forest.boundary_faces(facets)
        rows = np.stack([self._cell[leaf], face.astype(np.int32)], axis=1)
        return rows[np.lexsort(rows.T[::-1])]

    def positions(self, leaf: IntArray, local: IntArray, degree: int) -> FloatArray:
        """Positions (k, 3) [m] of nodes (k,) of degree p of this rank's leaves (k,) in the geometry of order q.

        Local.
        """
        functions = hexahedron.lagrange(self.order, np.linspace(0, 1, degree + 1))
        weights = np.kron(functions, np.kron(functions, functions))[:, basix_order(CellType.hexahedron, self.order)]
        nodes, result = compat.geometry_nodes(self.mesh), np.empty((len(leaf), 3))
        for node in np.unique(local):
            some, part = np.flatnonzero(local == node), np.flatnonzero(weights[node])
            result[some] = weights[node, part] @ self.mesh.geometry.x[nodes[self._cell[leaf[some]][:, None], part]]
        return result


def create_leaf_mesh(forest: Forest, order: int) -> LeafMesh:
    """Make the dolfinx mesh of a forest, distributed alike, of an order up to the root mesh's, at which it is exact.

    Collective on forest.comm.
    """
    nodes, x = _geometry_nodes(forest, order)
    variant = LagrangeVariant.equispaced
    element = basix.ufl.element("Lagrange", "hexahedron", order, lagrange_variant=variant, shape=(3,))
    cells, stay = nodes[:, basix_order(CellType.hexahedron, order)], compat.stay(forest.comm.rank)
    mesh = create_mesh(forest.comm, cells=cells, e=element, x=x, partitioner=stay)
    return LeafMesh(mesh, order, mesh.topology.original_cell_index - (forest.comm.exscan(len(forest)) or 0))


def sufficient_order(forest: Forest, tolerance: float) -> int:
    """The lowest geometry order that approximates the root map on every leaf.

    Collective on forest.comm.  The tolerance is for the distance between both maps, relative to the shortest of the
    leaf's three lengths.  Leaves are accurate if an ancestor is: levels are visited from the root cells on.
    """
    order, left = 1, np.arange(len(forest))
    for level in range(MAX_LEVEL + 1):
        if order == forest.mesh.order:
            break
        codes = leaf_code(forest.cell[left], forest.anchor[left] & -(SIDE >> level))
        _, first, ancestor = np.unique(codes, return_index=True, return_inverse=True)
        leaf = forest.level[left[first]] == level
        descend = np.zeros(len(first), dtype=bool)
        for start in range(0, len(first), _CHUNK // 32):
            part = slice(start, start + _CHUNK // 32)
            exact = leaf_positions(forest, left[first[part]], forest.mesh.order, level)
            deviates = _deviation(exact, order) > tolerance
            while order < forest.mesh.order and (deviates & leaf[part]).any():
                order += 1
                deviates[deviates] = _deviation(exact[deviates], order) > tolerance
            descend[part] = deviates & ~leaf[part]
        left = left[descend[ancestor]]
        state = np.array([order, len(left)])
        forest.comm.Allreduce(MPI.IN_PLACE, state, op=MPI.MAX)
        order, unfinished = state
        if not unfinished:
            break
    return int(order)


def _deviation(exact: FloatArray, order: int) -> FloatArray:
    """Distance (n,) of maps from their interpolants of an order, relative to the shortest length of the image.

    Evaluated at the nodes (n, (p+1)^3, 3) of the maps, which determine the difference.
    """
    p = hexahedron.order_of(exact.shape[1])
    to_nodes = hexahedron.lagrange(p, np.linspace(0, 1, order + 1))
    there_and_back = hexahedron.lagrange(order, np.linspace(0, 1, p + 1)) @ to_nodes
    distance = np.linalg.norm(hexahedron.tensor_evaluate((there_and_back,) * 3, exact) - exact, axis=2).max(axis=1)
    return distance / hexahedron.lengths(exact[:, hexahedron.corner_nodes(p)]).min(axis=1)


def leaf_positions(forest: Forest, leaves: IntArray | slice, order: int, level: int | None = None) -> FloatArray:
    """Positions (n, (p+1)^3, 3) [m] of the nodes of leaves (n,) on the exact curved geometry, in tensor order.

    Local.  The nodes are equispaced, of order p; with a level, of the ancestors of the leaves at that level.
    """
    levels = forest.level[leaves]
    side = leaf_side(levels if level is None else np.full_like(levels, level))[:, None]
    low, width = (forest.anchor[leaves] & -side) / SIDE, side / SIDE
    points = low[:, :, None] + width[:, :, None] * np.linspace(0, 1, order + 1)
    return forest.mesh.evaluate(forest.cell[leaves], points)


def _geometry_nodes(forest: Forest, order: int) -> tuple[Int64Array, FloatArray]:
    """Global nodes (n, (q+1)^3) of each leaf in tensor order, and the positions of the nodes numbered by this rank."""
    comm, inner = forest.comm, order - 1
    vertex, owner = forest.vertices.directory.number()
    corner = hexahedron.corner_nodes(order)[:, None]
    # Of vertices, edges, faces and cells: number, owner, entities of each leaf, their nodes, and the order of these.
    kinds: list[tuple[Int64Array, Int32Array, IntArray, Int64Array, Int64Array]]
    kinds = [(vertex, owner, forest.vertices.cells, corner, np.zeros(1, dtype=np.int64))]
    if order > 1:
        ends, edges, faces = vertex[forest.vertices.cells], forest.edges, forest.faces
        place = _edge_places(ends[:, hexahedron.EDGE_CORNERS], inner)
        kinds.append((*edges.directory.number(), edges.cells, hexahedron.edge_nodes(order)[:, 1:-1], place))
        place = _face_places(ends[:, hexahedron.FACE_CORNERS], inner)
        kinds.append((*faces.directory.number(), faces.cells, hexahedron.face_inner_nodes(order), place))
        cell = np.arange(len(forest), dtype=np.int64)
        inside = hexahedron.cell_inner_nodes(order)[None]
        here = np.full(len(cell), comm.rank, dtype=np.int32)
        kinds.append(((comm.exscan(len(cell)) or 0) + cell, here, cell[:, None], inside, np.arange(inner**3)))

    owned = [int((owner == comm.rank).sum()) for _, owner, *_ in kinds]
    count = np.array(comm.allgather(owned))
    first = np.cumsum(count, axis=0) - count
    width = count * [inside.shape[1] for *_, inside, _ in kinds]
    start = (np.cumsum(width) - width.ravel()).reshape(width.shape)

    nodes = np.empty((len(forest), (order + 1) ** 3), dtype=np.int64)
    for kind, (number, owner, cells, inside, place) in enumerate(kinds):
        base = start[owner, kind] + (number - first[owner, kind]) * inside.shape[1]
        nodes[:, inside] = base[cells][:, :, None] + place
    low = start[comm.rank, 0]
    x = np.empty((int(width[comm.rank].sum()), 3))
    for begin in range(0, len(forest), _CHUNK):
        part = slice(begin, begin + _CHUNK)
        mine = (nodes[part] >= low) & (nodes[part] < low + len(x))
        x[nodes[part][mine] - low] = leaf_positions(forest, part, order)[mine]
    return nodes, x


def _edge_places(ends: Int64Array, inner: int) -> Int64Array:
    """Order (n, 12, inner) of the inner nodes of each edge, from its end of lower number."""
    backward = ends[:, :, 1] < ends[:, :, 0]
    forward = np.arange(inner)
    return np.where(backward[:, :, None], inner - 1 - forward, forward)


def _face_places(corners: Int64Array, inner: int) -> Int64Array:
    """Order (n, 6, inner^2) of the inner nodes of each face, from its lowest corner towards the lower neighbour."""
    origin = corners.argmin(axis=2)[:, :, None]
    v, u = np.divmod(np.arange(inner**2), inner)
    u = np.where(origin & 1, inner - 1 - u, u)
    v = np.where(origin & 2, inner - 1 - v, v)
    swap = np.take_along_axis(corners, origin ^ 2, axis=2) < np.take_along_axis(corners, origin ^ 1, axis=2)
    return np.where(swap, v + inner * u, u + inner * v)


def basix_order(cell: CellType, order: int) -> Int64Array:
    """Tensor indices ((p + 1)^d,) of the nodes of Basix's Lagrange element of order p, from its points.  Local."""
    element = basix.create_element(basix.ElementFamily.P, cell, order, lagrange_variant=LagrangeVariant.equispaced)
    points = np.asarray(element.points)
    return np.rint(points * order).astype(np.int64) @ (order + 1) ** np.arange(points.shape[1])
