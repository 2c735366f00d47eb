"""The root mesh: coarse curved hexahedra with bodies, surfaces and points as names, the same on every rank.

The geometry of every leaf is the restriction of its root cell's map of order p, so refinement never changes the
domain (super-parametric elements, section 2 of the paper).  All but what takes a communicator is local.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from mpi4py import MPI

from fx_contact.parallel.meeting import collective
from fx_contact.parallel.mpi import together
from fx_contact.parallel.validation import check_comm, check_name
from fx_contact.problem import hexahedron
from fx_contact.problem.dolfinx_mesh import gathered_parts
from fx_contact.problem.root_mesh_checks import check_mesh, take_arrays
from fx_contact.problem.summary import mesh_summary

#: Lattices evaluated at once: few enough for the processor's cache.
_CHUNK = 1 << 12


@dataclass(frozen=True, eq=False, repr=False)
class RootMesh:
    """A conforming mesh of curved hexahedra of order 1 to 6, replicated on all ranks; checked when made.

    Lists will do for arrays and tuples.  All are frozen, copies where they are the caller's: to change a mesh, make
    another one (`dataclasses.replace`).

    Attributes:
        points: (npoints, 3) float64, node positions [m].
        cells: (ncells, (p+1)^3) int64, nodes of each cell in tensor order, x fastest (`hexahedron.grid_points`),
            equispaced in the reference cell.
        bodies: names of the bodies.
        body: (ncells,) int32, index into `bodies`.
        surfaces: name -> (n, 2) int32, exterior facets as (root cell, local face).
        vertices: name -> (n,) int64, nodes at cell corners, for conditions at points.
        curves: name -> (n, 2) int32, edges as (root cell, local edge), for conditions along lines.

    Raises:
        GeometryError: an inverted or degenerate cell, an order above 6, two cells that do not meet face to face.
        SceneError: a cell without body, two bodies with common nodes, a surface facet that is not on the boundary.
    """

    points: np.ndarray
    cells: np.ndarray
    bodies: tuple[str, ...]
    body: np.ndarray
    surfaces: dict[str, np.ndarray] = field(default_factory=dict)
    vertices: dict[str, np.ndarray] = field(default_factory=dict)
    curves: dict[str, np.ndarray] = field(default_factory=dict)

    def __post_init__(self):
        take_arrays(self)
        check_mesh(self)

    def __repr__(self):
        return mesh_summary(self)

    @classmethod
    @collective("comm")
    def from_dolfinx(cls, mesh, cell_tags, facet_tags, bodies, surfaces, comm=MPI.COMM_WORLD):
        """A dolfinx mesh of hexahedra as root mesh, gathered on all ranks; cells and nodes in the order of its input.

        Collective on comm.

        Args:
            mesh: dolfinx Mesh of hexahedra of order 1 to 6; bodies in contact share no nodes.
            cell_tags: dolfinx MeshTags that give each cell its body; None: all cells are of the only body.
            facet_tags: dolfinx MeshTags of facets.
            bodies: dict, tag -> name of a body.
            surfaces: dict, tag -> name of a surface, which several tags may share; facets with other tags are in none.
            comm: MPI communicator of the mesh.

        Returns:
            RootMesh, the same on all ranks.

        Raises:
            GeometryError: cells that are no complete hexahedra in 3D, or as `RootMesh`.
            SceneError: no mesh or tags of dolfinx, tags of other entities or of another mesh, no dicts of tag -> name,
                a cell that is in none of the bodies, another communicator, or as `RootMesh`.
        """
        check_comm(comm)
        parts = gathered_parts(comm, mesh, cell_tags, facet_tags, bodies, surfaces)
        with together(comm):
            return cls(**parts)

    @cached_property
    def order(self):
        """Polynomial order p of the cell maps."""
        return hexahedron.order_of(self.cells.shape[1])

    @cached_property
    def corners(self):
        """(ncells, 8) int64: the nodes at the cell corners, tensor order."""
        return self.cells[:, hexahedron.corner_nodes(self.order)]

    @cached_property
    def edges(self):
        """(ncells, 12) int64: a number for each local edge, the same in all cells that share it."""
        ends = np.sort(self.corners[:, hexahedron.EDGE_CORNERS], axis=2).reshape(-1, 2)
        return np.unique(ends, axis=0, return_inverse=True)[1].reshape(-1, 12)

    @cached_property
    def faces(self):
        """(ncells, 6) int64: a number for each local face, the same in all cells that share it."""
        corners = np.sort(self.corners[:, hexahedron.FACE_CORNERS], axis=2).reshape(-1, 4)
        return np.unique(corners, axis=0, return_inverse=True)[1].reshape(-1, 6)

    @cached_property
    def face_neighbours(self):
        """(ncells, 6) int64: how many cells share each local face (1: exterior)."""
        return np.bincount(self.faces.ravel())[self.faces]

    def surface(self, name):
        """Facets of a named surface.

        Args:
            name: a key of `surfaces`.

        Returns:
            (n, 2) int32 rows (root cell, local face).

        Raises:
            SceneError: there is no such surface.
        """
        check_name("surface", name, self.surfaces, "the root mesh has")
        return self.surfaces[name]

    def facet_points(self, facets, order=None):
        """Positions on curved facets, at the lattice of a given order.

        Args:
            facets: (n, 2) int (root cell, local face).
            order: lattice order; default the order of the mesh, whose lattice is its nodes.

        Returns:
            (n, (order+1)^2, 3) float64 [m], first tangent of the face fastest.
        """
        order = order or self.order
        functions = hexahedron.lagrange(self.order, np.linspace(0, 1, order + 1))
        values = hexahedron.tensor_evaluate((functions,) * 3, self.points[self.cells[facets[:, 0]]])
        return np.take_along_axis(values, hexahedron.face_nodes(order)[facets[:, 1]][:, :, None], axis=1)

    def outward_normals(self, facets):
        """Mean unit normals of facets, out of their cells.

        Args:
            facets: (n, 2) int (root cell, local face).

        Returns:
            (n, 3) float64 [-].
        """
        corners = self.facet_points(facets, order=1)
        normal = np.cross(corners[:, 1] - corners[:, 2], corners[:, 3] - corners[:, 0])
        normal *= hexahedron.FACE_ORIENTATION[facets[:, 1]][:, None]
        return normal / np.linalg.norm(normal, axis=1)[:, None]

    def evaluate(self, cells, coordinates):
        """Positions of tensor lattices of points inside root cells.

        Local.

        Args:
            cells: (n,) int, root cells.
            coordinates: (n, 3, m) float64, reference coordinates in [0, 1] along each axis.

        Returns:
            (n, m^3, 3) float64 [m], tensor order, x fastest.
        """
        m = coordinates.shape[2]
        result = np.empty((len(cells), m**3, 3))
        for start in range(0, len(cells), _CHUNK):
            part = slice(start, start + _CHUNK)
            result[part] = self._evaluate(cells[part], coordinates[part])
        return result

    def _evaluate(self, cells, coordinates):
        """The same for few lattices at once: those with equal z, or z and y, in a root cell share the work on these."""
        n, k, m = len(cells), self.order + 1, coordinates.shape[2]
        layer, of_layer = _distinct(cells, coordinates[:, 2])
        column, of_column = _distinct(of_layer, coordinates[:, 1])
        fx, fy, fz = (
            hexahedron.lagrange(self.order, coordinates[rows, axis])
            for axis, rows in enumerate((slice(None), column, layer))
        )
        nodal = self.points[self.cells[cells[layer]]].reshape(len(layer), k * k, k, 3).swapaxes(2, 3)  # x last
        values = fz @ nodal.reshape(len(layer), k, k * k * 3)
        values = fy[:, None] @ values.reshape(len(layer), m, k, k * 3)[of_layer[column]]
        values = values.reshape(len(column), m * m * 3, k)[of_column] @ fx.swapaxes(1, 2)
        return values.reshape(n, m * m, 3, m).swapaxes(2, 3).reshape(n, m**3, 3)


def _distinct(number, coordinates):
    """First rows of each different (number, coordinates), and which of them each row is: (k,) int64, (n,) int64."""
    order = np.lexsort((*coordinates.T, number))
    number, coordinates = number[order], coordinates[order]
    new = np.ones(len(order), dtype=bool)
    new[1:] = (number[1:] != number[:-1]) | (coordinates[1:] != coordinates[:-1]).any(axis=1)
    which = np.empty(len(order), dtype=np.int64)
    which[order] = np.cumsum(new) - 1
    return order[new], which
