"""Linear elasticity in UFL, and its stiffness on the conforming unknowns, P^T K P, assembled without K."""

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import assemble_matrix_mat
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import bsr_matrix, identity, kron

from fx_contact.matrix import create_matrix

#: Degree of the Gauss rule for Q1 on curved cells: 2 x 2 x 2 points.
QUADRATURE_DEGREE = 3
#: Cells of which P^T K P is taken at once.
_CHUNK = 1 << 13


class Elasticity:
    """Q1 displacements on a leaf mesh with one material a body.

    Collective on mesh.comm.

    Args:
        leaf_mesh: LeafMesh.
        materials: (nbodies, 2) float64 rows (E [Pa], nu [-]), in the order of the bodies.
        body: (ncells,) int32, body of each local cell.
        prolongation: Prolongation of the forest.
        stages: Stages, for the times.

    Attributes:
        leaf_mesh: as given.
        mesh: its dolfinx mesh.
        prolongation: as given.
        space: displacement space, a block of 3 a vertex.
        u: displacement, a Function [m].
        vertex_of_block: (nblocks,) int64, position in the forest's vertices of each local block of `space`.
        lame: the two Lame coefficients, Functions constant on cells [Pa].
    """

    def __init__(self, leaf_mesh, materials, body, prolongation, stages):
        self.mesh = mesh = leaf_mesh.mesh
        self.prolongation = prolongation
        self.space = fem.functionspace(mesh, ("Lagrange", 1, (3,)))
        constant = fem.functionspace(mesh, ("DG", 0))
        self.u = fem.Function(self.space, name="displacement")
        self.leaf_mesh, self._stages, self._energy = leaf_mesh, stages, None
        blocks = self.space.dofmap.list
        imap = self.space.dofmap.index_map
        self.vertex_of_block = np.empty(imap.size_local + imap.num_ghosts, dtype=np.int64)
        self.vertex_of_block[blocks] = leaf_mesh.vertices
        young, poisson = materials[body].T
        self.lame = fem.Function(constant), fem.Function(constant)
        cells = constant.dofmap.list[:, 0]
        self.lame[0].x.array[cells] = young * poisson / ((1 + poisson) * (1 - 2 * poisson))
        self.lame[1].x.array[cells] = young / (2 * (1 + poisson))

    def stress(self, u):
        """Cauchy stress [Pa] of a displacement, a UFL expression."""
        strain = ufl.sym(ufl.grad(u))
        return self.lame[0] * ufl.tr(strain) * ufl.Identity(3) + 2 * self.lame[1] * strain

    def set_displacement(self, conforming):
        """Set `u` on all vertices from the owned conforming values (owned, 3) [m].  Collective."""
        values = self.prolongation.prolong(conforming)
        self.u.x.array[:] = values[self.vertex_of_block].ravel()

    def energy_norm(self, conforming):
        """omega (4) of a displacement [J^(1/2)].

        Collective.

        Args:
            conforming: (owned, 3) float64 [m].

        Returns:
            float, the same on all ranks.
        """
        self.set_displacement(conforming)
        if self._energy is None:
            dx = ufl.Measure("dx", self.mesh, metadata={"quadrature_degree": QUADRATURE_DEGREE})
            with self._stages("compile"):
                self._energy = fem.form(ufl.inner(self.stress(self.u), ufl.sym(ufl.grad(self.u))) * dx)
        return float(np.sqrt(max(self.prolongation.comm.allreduce(fem.assemble_scalar(self._energy)), 0.0)))

    def stiffness(self, pairs=None):
        """P^T K P on the conforming unknowns, with room for contact blocks.

        Collective on mesh.comm.  Cells without hanging vertex go straight into the matrix; for the others the product
        is taken on this rank's part of K, which has only their rows.

        Args:
            pairs: NodePairs, or None without contact.

        Returns:
            BlockMatrix, not yet assembled: `mat.assemble` ends it.
        """
        imap = self.prolongation.index_map
        conforming = self.prolongation.conforming[self.vertex_of_block]
        number = imap.local_to_global(np.arange(imap.size_local + imap.num_ghosts, dtype=np.int32)).astype(np.int32)
        blocks = np.where(conforming >= 0, number[conforming], -1).astype(np.int32)
        matrix = create_matrix(self.prolongation, self.leaf_mesh.vertices, pairs)
        lgmap = PETSc.LGMap().create(blocks, bsize=3, comm=self.mesh.comm)
        matrix.mat.setLGMap(lgmap, lgmap)

        irregular = (conforming[self.space.dofmap.list] < 0).any(axis=1)
        assemble_matrix_mat(matrix.mat, self._form(np.flatnonzero(~irregular)))
        self._add_irregular(matrix.mat, np.flatnonzero(irregular), number)
        return matrix

    def _form(self, cells):
        trial, test = ufl.TrialFunction(self.space), ufl.TestFunction(self.space)
        domain = [(1, np.asarray(cells, dtype=np.int32))]
        dx = ufl.Measure("dx", self.mesh, subdomain_data=domain, metadata={"quadrature_degree": QUADRATURE_DEGREE})
        with self._stages("compile"):
            return fem.form(ufl.inner(self.stress(trial), ufl.sym(ufl.grad(test))) * dx(1))

    def _add_irregular(self, matrix, cells, number):
        """Add P^T K P of some cells, few at a time: the product needs much more room than its result."""
        comm = self.prolongation.comm
        for part in range(comm.allreduce(-(-len(cells) // _CHUNK), op=MPI.MAX)):
            form = self._form(cells[part * _CHUNK : (part + 1) * _CHUNK])
            local = fem.create_matrix(form)
            fem.assemble_matrix(local, form)
            # The columns are this rank's blocks, then those that other ranks' rows brought along, here without values.
            columns = local.index_map(1).size_local + local.index_map(1).num_ghosts
            rows = np.flatnonzero(np.diff(local.indptr))
            stiffness = bsr_matrix(
                (local.data.reshape(-1, 3, 3), local.indices, np.append(local.indptr[rows], len(local.indices))),
                shape=(3 * len(rows), 3 * columns),
            )
            interpolation = self.prolongation.matrix[self.vertex_of_block]
            to_rows = kron(interpolation[rows], identity(3), format="bsr")
            interpolation.resize(columns, interpolation.shape[1])
            interpolation = kron(interpolation, identity(3), format="bsr")
            product = (to_rows.T @ (stiffness @ interpolation)).tobsr((3, 3))
            rows = np.flatnonzero(np.diff(product.indptr))
            indptr = np.append(product.indptr[rows], len(product.indices)).astype(np.int32)
            matrix.setValuesBlockedIJV(
                indptr, number[product.indices], product.data, addv=PETSc.InsertMode.ADD, rowmap=number[rows]
            )
