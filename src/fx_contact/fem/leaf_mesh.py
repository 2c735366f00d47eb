"""From forest leaves to a dolfinx mesh with geometry of order q, and back from its cells to the leaves.

Geometry nodes are shared by entity of the leaf mesh: a fine vertex and the middle node of a coarse edge at the same
place are different nodes, as dolfinx needs it on meshes with hanging nodes.
"""

from dataclasses import dataclass

import basix.ufl
import numpy as np
from basix import CellType, LagrangeVariant
from dolfinx.mesh import create_mesh
from mpi4py import MPI

from fx_contact.parallel import compat
from fx_contact.problem import hexahedron
from fx_contact.problem.facet_pairing import leaf_code
from fx_contact.problem.lattice import MAX_LEVEL, SIDE, leaf_side

#: Leaves whose positions are computed at once: few enough for the processor's cache.
_CHUNK = 1 << 13


@dataclass(frozen=True, eq=False)
class LeafMesh:
    """A dolfinx mesh whose cells are leaves.

    Attributes:
        mesh: dolfinx Mesh; every rank's cells are its leaves, none is a ghost.
        order: geometry order q.
        leaf: (ncells,) int64, this rank's leaf of each local cell.
    """

    mesh: object
    order: int
    leaf: np.ndarray

    def facets(self, forest, facets):
        """Exterior facets that lie on given root facets, as dolfinx integrates over them.

        Local.  Hanging facets, which dolfinx takes for exterior ones, are not among them.

        Args:
            forest: the Forest of the mesh.
            facets: (k, 2) int rows (root cell, local face).

        Returns:
            (m, 2) int32 rows (local cell, local facet).
        """
        leaf, face = forest.boundary_faces(facets)
        cell = np.empty(len(self.leaf), dtype=np.int32)
        cell[self.leaf] = np.arange(len(cell))
        rows = np.stack([cell[leaf], face.astype(np.int32)], axis=1)
        return rows[np.lexsort(rows.T[::-1])]

    def positions(self, leaf, local, degree):
        """Where nodes of leaves are in the geometry of order q, over which the mesh is integrated.

        Local.

        Args:
            leaf: (k,) int, this rank's leaves.
            local: (k,) int, a node of each, in tensor order.
            degree: p of the nodes, i/p along each axis.

        Returns:
            (k, 3) float64 [m].
        """
        cell = np.empty(len(self.leaf), dtype=np.int32)
        cell[self.leaf] = np.arange(len(cell))
        along = hexahedron.lagrange(self.order, np.linspace(0, 1, degree + 1))
        weights = np.kron(along, np.kron(along, along))[:, basix_order(CellType.hexahedron, self.order)]
        return np.einsum(
            "kn,kni->ki", weights[local], self.mesh.geometry.x[compat.geometry_nodes(self.mesh)[cell[leaf]]]
        )


def create_leaf_mesh(forest, order):
    """Make the dolfinx mesh of a forest.

    Collective on forest.comm.

    Args:
        forest: Forest, distributed as the mesh shall be.
        order: geometry order q, at most that of the root mesh; with q equal to it the leaf maps are exact.

    Returns:
        LeafMesh.
    """
    nodes, x = _geometry_nodes(forest, order)
    element = basix.ufl.element(
        "Lagrange", "hexahedron", order, lagrange_variant=LagrangeVariant.equispaced, shape=(3,)
    )
    mesh = create_mesh(
        forest.comm,
        cells=nodes[:, basix_order(CellType.hexahedron, order)],
        e=element,
        x=x,
        partitioner=compat.stay(forest.comm.rank),
    )
    first = forest.comm.exscan(len(forest)) or 0
    leaf = mesh.topology.original_cell_index - first
    return LeafMesh(mesh, order, leaf)


def sufficient_order(forest, tolerance):
    """The lowest geometry order that holds the root map on every leaf.

    Collective on forest.comm.  The deviation of a map of order q, relative to the shortest of the cell's three lengths,
    falls like h^q: where it is small enough on an ancestor of leaves it is so on them.  So it is looked at level by
    level, from the root cells on, only below ancestors on which it is too large.

    Args:
        forest: Forest.
        tolerance: largest distance between the map of order q and that of the root cell, relative to the shortest of
            the leaf's three lengths: the thickness of a shell.

    Returns:
        int, 1 to the order of the root mesh.
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


def _deviation(exact, order):
    """Largest distance of maps from their interpolants of an order, relative to the shortest length of the image: (n,).

    Seen at the maps' own nodes, (n, (p+1)^3, 3): the difference has no more freedom than that.
    """
    p = hexahedron.order_of(exact.shape[1])
    to_nodes = hexahedron.lagrange(p, np.linspace(0, 1, order + 1))
    there_and_back = hexahedron.lagrange(order, np.linspace(0, 1, p + 1)) @ to_nodes
    distance = np.linalg.norm(hexahedron.tensor_evaluate((there_and_back,) * 3, exact) - exact, axis=2).max(axis=1)
    return distance / hexahedron.lengths(exact[:, hexahedron.corner_nodes(p)]).min(axis=1)


def leaf_positions(forest, leaves, order, level=None):
    """Positions of the equispaced nodes of leaves, or of their ancestors, on the true curved geometry.

    Local.

    Args:
        forest: Forest.
        leaves: (n,) int, or what else picks n of the leaves.
        order: of the nodes, p.
        level: of the ancestors; None: the leaves themselves.

    Returns:
        (n, (p+1)^3, 3) float64 [m], tensor order.
    """
    side = leaf_side(forest.level[leaves] if level is None else np.full(len(leaves), level))[:, None]
    low, side = (forest.anchor[leaves] & -side) / SIDE, side / SIDE
    return forest.mesh.evaluate(
        forest.cell[leaves], low[:, :, None] + side[:, :, None] * np.linspace(0, 1, order + 1)
    )


def _geometry_nodes(forest, order):
    """Global nodes of each leaf in tensor order, (n, (q+1)^3) int64, and the positions of those this rank numbers.

    Nodes are numbered rank by rank; on a rank those of vertices, then of edges, faces and cells.
    """
    comm, inner = forest.comm, order - 1
    vertex, owner = forest.vertices.directory.number()
    kinds = [(vertex, owner, forest.vertices.cells, hexahedron.corner_nodes(order)[:, None], 0)]
    if order > 1:
        ends = vertex[forest.vertices.cells]
        for entities, corners, inside in (
            (forest.edges, hexahedron.EDGE_CORNERS, hexahedron.edge_inner_nodes(order)),
            (forest.faces, hexahedron.FACE_CORNERS, hexahedron.face_inner_nodes(order)),
        ):
            place = (
                _edge_places(ends[:, corners], inner)
                if corners.shape[1] == 2
                else (_face_places(ends[:, corners], inner))
            )
            kinds.append((*entities.directory.number(), entities.cells, inside, place))
        cell = np.arange(len(forest))
        inside = hexahedron.cell_inner_nodes(order)
        here = np.full(len(cell), comm.rank, dtype=np.int32)
        kinds.append(((comm.exscan(len(cell)) or 0) + cell, here, cell[:, None], inside[None], np.arange(inner**3)))

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


def _edge_places(ends, inner):
    """Where the inner nodes of each edge come, counted from its end of lower number: (n, 12, inner)."""
    backward = ends[:, :, 1] < ends[:, :, 0]
    along = np.arange(inner)
    return np.where(backward[:, :, None], inner - 1 - along, along)


def _face_places(corners, inner):
    """Where the inner nodes of each face come, counted from its lowest corner towards the lower neighbour first."""
    origin = corners.argmin(axis=2)[:, :, None]
    v, u = np.divmod(np.arange(inner**2), inner)
    u = np.where(origin & 1, inner - 1 - u, u)
    v = np.where(origin & 2, inner - 1 - v, v)
    swap = np.take_along_axis(corners, origin ^ 2, axis=2) < np.take_along_axis(corners, origin ^ 1, axis=2)
    return np.where(swap, v + inner * u, u + inner * v)


def basix_order(cell, order):
    """Tensor index of each node of Basix's Lagrange element, read off its points.

    Local.

    Args:
        cell: CellType of a quadrilateral or hexahedron.
        order: of the element.

    Returns:
        ((order + 1)^d,) int64.
    """
    element = basix.create_element(basix.ElementFamily.P, cell, order, lagrange_variant=LagrangeVariant.equispaced)
    return np.rint(element.points * order).astype(np.int64) @ (order + 1) ** np.arange(element.points.shape[1])
