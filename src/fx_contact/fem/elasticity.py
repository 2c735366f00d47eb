"""Linear elasticity in UFL, and its stiffness on the conforming unknowns, P^T K P, assembled without K.

Nearly incompressible cells lock: their volume strain has more conditions than a cell has freedom.  In bodies that need
it, it is projected in each cell on the polynomials q of degree p - 1 in reference coordinates.  Its energy is

    lambda m^T M^-1 m,    m_i = int q_i div u,    M_ij = int q_i q_j.

That is the pair Q_p / P_(p-1) discontinuous with the pressure eliminated (D. S. Malkus, T. J. R. Hughes, Comput.
Methods Appl. Mech. Eng. 15(1), 1978).  At degree 1 that is the mean of each cell (B-bar: J. C. Nagtegaal, D. M. Parks,
J. R. Rice, Comput. Methods Appl. Mech. Eng. 4(2), 1974).  Linear displacements stay exact on distorted cells.
"""

import basix.ufl
import numpy as np
import ufl
from basix import CellType
from dolfinx import fem
from mpi4py import MPI
from scipy.sparse import csr_matrix

from fx_contact.fem.cell_products import add_cells, cell_constraints, cell_matrices, constrained
from fx_contact.fem.compilation import compiled
from fx_contact.fem.leaf_mesh import basix_order
from fx_contact.fem.volume_term import VolumeTerm
from fx_contact.linalg.matrix import create_matrix
from fx_contact.parallel.memory import give_back

#: Poisson's ratio from which on the volume strain of a body is projected.
LOCKING_POISSON = 0.4
#: Poisson's ratio of the matrix A of the mixed form in such bodies, measured (`studies.incompressible.run --matrix`).
MATRIX_POISSON = 0.3
#: Entries of the matrices of cells that are made at once: 32 MB, and as much three times more on hanging nodes.
_CHUNK = 1 << 22


class Elasticity:
    """Displacements of degree p on a leaf mesh with one material a body.

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
        function_space: of displacements, a block of 3 a node.
        u: displacement, a Function [m].
        quadrature_degree: of the Gauss rule on curved cells, 2p + 1: (p+1)^3 points.
        cells: (ncells, (p+1)^3) int32, position in the Space of the nodes of each local cell.
        node_of_block: (nblocks,) int64, the same of each local block of `function_space`; several blocks may be a node.
        lame: the two Lame coefficients, Functions constant on cells [Pa].
        volume_strain: that of `u`, a UFL expression; projected in nearly incompressible bodies [-].
        projects: whether there are such bodies; the energy of a displacement then depends on the cells.
    """

    def __init__(self, leaf_mesh, materials, body, prolongation, stages):
        self._bodies = materials, body
        self.mesh = mesh = leaf_mesh.mesh
        self.prolongation = prolongation
        self.quadrature_degree = 2 * prolongation.space.degree + 1
        self.function_space = self.nodal_space(3)
        constant = fem.functionspace(mesh, ("DG", 0))
        self.leaf_mesh, self._stages, self._energy = leaf_mesh, stages, None
        imap, self.cells = self.function_space.dofmap.index_map, prolongation.space.cells[leaf_mesh.leaf]
        self.node_of_block = np.empty(imap.size_local + imap.num_ghosts, dtype=np.int64)
        self._order = basix_order(CellType.hexahedron, prolongation.space.degree)
        self.node_of_block[self.function_space.dofmap.list] = self.cells[:, self._order]
        count = len(self.node_of_block)
        entries = np.ones(count), (self.node_of_block, np.arange(count))
        self._gather = csr_matrix(entries, shape=(len(prolongation.space), count))
        young, poisson = materials[body].T
        self.lame = fem.Function(constant), fem.Function(constant)
        cells = constant.dofmap.list[:, 0]
        self.lame[0].x.array[cells] = young * poisson / ((1 + poisson) * (1 - 2 * poisson))
        self.lame[1].x.array[cells] = young / (2 * (1 + poisson))
        self._soft = poisson >= LOCKING_POISSON
        self.projects = (materials[:, 1] >= LOCKING_POISSON).any()
        if self.projects:
            self._pointwise = fem.Function(constant)
            self._pointwise.x.array[cells] = ~self._soft
            self._volume_strains = fem.functionspace(mesh, ("DPC", prolongation.space.degree - 1))
            self._inverse_mass = self._inverted_mass()
        self.u, self.volume_strain, self._project_u = self._displacement("displacement")
        self._v, self._volume_strain_of_v, self._project_v = self._displacement("v")

    def _inverted_mass(self):
        """M^-1 of each cell: (ncells, k, k)."""
        q, test = ufl.TrialFunction(self._volume_strains), ufl.TestFunction(self._volume_strains)
        unknowns = self._volume_strains.dofmap.list
        order, mass = cell_matrices(self._compiled(q * test), unknowns, unknowns)
        inverse = np.empty_like(mass)
        inverse[order] = np.linalg.inv(mass)
        return inverse

    def _displacement(self, name):
        """A displacement Function, its volume strain in UFL, and a function that projects that anew."""
        u = fem.Function(self.function_space, name=name)
        if not self.projects:
            return u, ufl.div(u), lambda: None
        projected = fem.Function(self._volume_strains)
        moments = self._compiled(ufl.TestFunction(self._volume_strains), ufl.div(u))

        def project():
            """L2 projection of div u in each cell, by its moments.  Local."""
            of_cells = fem.assemble_vector(moments).array[self._volume_strains.dofmap.list]
            projected.x.array[self._volume_strains.dofmap.list] = np.einsum(
                "nij,nj->ni", self._inverse_mass, of_cells
            )

        return u, self._pointwise * ufl.div(u) + (1 - self._pointwise) * projected, project

    def on(self, prolongation):
        """The same bodies with displacements of another degree: Elasticity.  Collective.

        Args:
            prolongation: Prolongation of a Space on the same forest.
        """
        return Elasticity(self.leaf_mesh, *self._bodies, prolongation, self._stages)

    def nodal_space(self, components):
        """Continuous functions of the displacement's degree with some components.  Collective."""
        return fem.functionspace(self.mesh, ("Lagrange", self.prolongation.space.degree, (components,)))

    def at_blocks(self, values):
        """Values at all nodes (m, k) as the array of a Function of a nodal space: (nblocks * k,).  Local."""
        return values[self.node_of_block].ravel()

    def at_nodes(self, blocks):
        """What this rank's cells contribute to their nodes, not summed over ranks.

        Local.

        Args:
            blocks: (nblocks * k,) float64, an assembled vector of a nodal space.

        Returns:
            (m, k) float64; the blocks of one node are added.
        """
        return self._gather @ blocks.reshape(len(self.node_of_block), -1)

    def at_leaves(self, function):
        """Values of a Function of a nodal space at the nodes of this rank's leaves: (n, (p+1)^3, k).  Local."""
        values = function.x.array.reshape(len(self.node_of_block), -1)[function.function_space.dofmap.list]
        result = np.empty_like(values)
        result[self.leaf_mesh.leaf[:, None], self._order] = values
        return result

    def stress(self, u, volume_strain=None):
        """Cauchy stress [Pa] of a displacement, a UFL expression.

        Args:
            u: displacement [m].
            volume_strain: if not the divergence of u [-].
        """
        volume_strain = ufl.div(u) if volume_strain is None else volume_strain
        return self.lame[0] * volume_strain * ufl.Identity(3) + 2 * self.lame[1] * ufl.sym(ufl.grad(u))

    def set_displacement(self, conforming):
        """Set `u` at all nodes from the owned conforming values (owned, 3) [m].  Collective."""
        self._set(self.u, conforming)
        self._project_u()

    def _set(self, function, conforming):
        function.x.array[:] = self.at_blocks(self.prolongation.prolong(conforming))

    def energy_norm(self, conforming):
        """omega (4) of a displacement [J^(1/2)]; `u` stays.

        Collective.

        Args:
            conforming: (owned, 3) float64 [m].

        Returns:
            float, the same on all ranks.
        """
        if self._energy is None:
            self._energy = self._compiled(self._energy_of_v(self._volume_strain_of_v**2))
        self._set(self._v, conforming)
        self._project_v()
        return self._root(self._energy)

    def change_norm(self, conforming):
        """Energy norm of the difference between solutions on this mesh and on a coarser one [J^(1/2)]; `u` stays.

        Collective.  Without that of projected volume strains: those of the children of a cell are not the cell's.

        Args:
            conforming: (owned, 3) float64 [m].

        Returns:
            float, the same on all ranks.
        """
        if not self.projects:
            return self.energy_norm(conforming)
        self._set(self._v, conforming)
        return self._root(self._compiled(self._energy_of_v(self._pointwise * ufl.div(self._v) ** 2)))

    def _energy_of_v(self, volume_strain2):
        """Twice the energy density of `_v`, given the square of its volume strain, in UFL."""
        strain = ufl.sym(ufl.grad(self._v))
        return 2 * self.lame[1] * ufl.inner(strain, strain) + self.lame[0] * volume_strain2

    def _root(self, energy):
        """Root of a compiled energy on all ranks: float."""
        return float(np.sqrt(max(self.prolongation.comm.allreduce(fem.assemble_scalar(energy)), 0.0)))

    def internal_forces(self):
        """P^T K u, integrated from the stress of `u` without a matrix: (owned, 3) float64 [N].  Collective."""
        test = ufl.TestFunction(self.function_space)
        stress = self.stress(self.u, self.volume_strain)
        forces = fem.assemble_vector(self._compiled(ufl.inner(stress, ufl.sym(ufl.grad(test))))).array
        return self.prolongation.restrict(self.at_nodes(forces))

    @property
    def mixed(self):
        """Whether the pressure of nearly incompressible bodies is an unknown: at degree 2, where that is stable."""
        return bool(self.projects and self.prolongation.space.degree > 1)

    def stiffness(self, rows=None, copied=True, mixed=False, supports=None):
        """P^T K P on the conforming unknowns, with room for contact blocks.

        Collective on mesh.comm.

        Args:
            rows: ConstraintRows, or None without contact.
            copied: as `create_matrix` has it.
            mixed: whether the volume strain of nearly incompressible bodies has the weight that `volume_term` leaves.
            supports: Supports at the owned conforming nodes, by which it is projected on oblique planes; None: not.

        Returns:
            BlockMatrix, not yet assembled: `mat.assemble` ends it.
        """
        matrix, imap = create_matrix(self.prolongation, self.cells, rows, copied), self.prolongation.index_map
        number = imap.local_to_global(np.arange(imap.size_local + imap.num_ghosts, dtype=np.int32)).astype(np.int32)
        supports = supports.ghosted(self.prolongation) if supports is not None and supports.oblique else None
        hangs = (self.prolongation.conforming[self.cells] < 0).any(axis=1)
        degree = self.prolongation.space.degree
        element = basix.ufl.element("Lagrange", "hexahedron", degree, shape=(3,), discontinuous=True)
        space = fem.functionspace(self.mesh, element)
        # dolfinx assembles square blocks alone: the three terms of the divergence have a row each.
        moments = fem.functionspace(self.mesh, ("DPC", degree - 1, (3,))) if self.projects else None
        for some in (np.flatnonzero(~hangs), np.flatnonzero(hangs)):
            for part in self._chunks(some):
                unknowns = space.dofmap.list[part]
                order, matrices = cell_matrices(self._form(part, space), unknowns, unknowns)
                part = part[order]
                if self.projects:
                    self._add_projected(matrices, part, space, moments, mixed)
                nodes = self.prolongation.conforming[self.cells[part][:, self._order]]
                if hangs[part].any():
                    nodes, weights = cell_constraints(self.prolongation, self.cells[part][:, self._order])
                    matrices = constrained(matrices, weights)
                if supports is not None:
                    matrices = supports.in_cells(matrices, nodes)
                add_cells(matrix.mat, matrices, number[nodes])
        give_back()
        return matrix

    def _compiled(self, integrand, factor=1.0, cells=None):
        """The integral over some cells of this rank, or all, compiled."""
        where, domain = ("everywhere", None) if cells is None else (1, [(1, np.asarray(cells, dtype=np.int32))])
        dx = ufl.Measure("dx", self.mesh, where, {"quadrature_degree": self.quadrature_degree}, domain)
        with self._stages("compile"):
            return compiled(self.prolongation.comm, factor * integrand * dx)

    def _form(self, cells, space):
        """Stiffness of some cells, but for projected volume strains."""
        trial, test = ufl.TrialFunction(space), ufl.TestFunction(space)
        stress = self.stress(trial, self._pointwise * ufl.div(trial) if self.projects else None)
        return self._compiled(ufl.inner(stress, ufl.sym(ufl.grad(test))), cells=cells)

    def volume_term(self, supports):
        """What the matrix of the mixed form lacks of the stiffness.

        Collective on mesh.comm.

        Args:
            supports: Supports at the owned conforming nodes.

        Returns:
            VolumeTerm.
        """
        degree, parts, cells = self.prolongation.space.degree, [], []
        element = basix.ufl.element("Lagrange", "hexahedron", degree, shape=(3,), discontinuous=True)
        space = fem.functionspace(self.mesh, element)
        moments = fem.functionspace(self.mesh, ("DPC", degree - 1, (3,)))
        for part in self._chunks(np.flatnonzero(self._soft)):
            part, d = self._moments(part, space, moments)
            orthonormal = np.linalg.cholesky(self._inverse_mass[part]).transpose(0, 2, 1)
            parts.append((self.cells[part][:, self._order], orthonormal @ d))
            cells.append(np.repeat(part, d.shape[1]))
        first, second = (np.concatenate([self._of_cells(lame, part) for part in cells]) for lame in self.lame)
        held = _first_lame(second)
        return VolumeTerm(self.prolongation, parts, first - held, 2 * second + held, supports)

    def _of_cells(self, lame, cells):
        """A Lame coefficient of cells: (n,) float64."""
        return lame.x.array[lame.function_space.dofmap.list[cells, 0]]

    def _moments(self, cells, space, moments):
        """Cells in the order of their moments D of the divergence, and D: (n, q, 3 k) float64."""
        trial, test = ufl.TrialFunction(space), ufl.TestFunction(moments)
        form = self._compiled(sum(test[i] * trial[i].dx(i) for i in range(3)), cells=cells)
        order, d = cell_matrices(form, moments.dofmap.list[cells], space.dofmap.list[cells])
        n, count, k, *_ = d.shape
        return cells[order], d.sum(axis=3).reshape(n, count, 3 * k)

    def _add_projected(self, matrices, cells, space, moments, mixed):
        """Add D^T (lambda M^-1) D to the matrices of cells whose volume strain is projected, with m = D u."""
        soft = np.flatnonzero(self._soft[cells])
        place = np.full(len(self._soft), -1)
        place[cells[soft]] = soft
        some, d = self._moments(cells[soft], space, moments)
        first, k = self._of_cells(self.lame[0], some), d.shape[2] // 3
        if mixed:
            first = _first_lame(self._of_cells(self.lame[1], some))
        product = d.transpose(0, 2, 1) @ (first[:, None, None] * self._inverse_mass[some] @ d)
        matrices[place[some]] += product.reshape(-1, k, 3, k, 3).transpose(0, 1, 3, 2, 4)

    def _chunks(self, cells):
        """Parts of this rank's cells, as many on all ranks."""
        size = _CHUNK // (3 * self.cells.shape[1]) ** 2
        parts = self.prolongation.comm.allreduce(-(-len(cells) // size), op=MPI.MAX)
        return (cells[part * size : (part + 1) * size] for part in range(parts))


def _first_lame(second):
    """The first Lame coefficient for `MATRIX_POISSON` and the second one."""
    return 2 * MATRIX_POISSON / (1 - 2 * MATRIX_POISSON) * second
