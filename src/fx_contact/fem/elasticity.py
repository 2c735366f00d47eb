"""Linear elasticity in UFL, and its stiffness on the conforming unknowns, P^T K P, assembled without K."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import ufl
from dolfinx import fem
from scipy.sparse import csr_matrix

from fx_contact.fem.anisotropy import Anisotropy
from fx_contact.fem.cell_products import CellSum, cell_constraints, constrained, node_couplings
from fx_contact.fem.cell_stiffness import CellStiffness, parts
from fx_contact.fem.displacement_field import DisplacementField, Integral
from fx_contact.fem.leaf_mesh import LeafMesh
from fx_contact.fem.nodal_spaces import NodalSpaces
from fx_contact.fem.nodal_stress import NodalStress
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.springs import Springs
from fx_contact.fem.supports import Supports
from fx_contact.fem.volume_projection import VolumeProjection
from fx_contact.fem.volume_term import VolumeTerm
from fx_contact.items.materials import Material, Orthotropic
from fx_contact.linalg.matrix import BlockMatrix, create_matrix
from fx_contact.parallel.arrays import FloatArray, IntArray
from fx_contact.parallel.memory import give_back
from fx_contact.parallel.timing import Stages

#: Poisson's ratio of the matrix A of the mixed form in such bodies, measured (`studies.incompressible.run --matrix`).
MATRIX_POISSON = 0.3


class Rows(Protocol):
    """Rows of contact: `contact.constraint_rows.ConstraintRows`."""

    def couplings(self) -> csr_matrix:
        """Couplings of the nodes of the index map by a row: bool."""


class Elasticity(NodalSpaces):
    """Displacements of degree p, in `NodalSpaces`, on a leaf mesh whose cells have one of several materials.

    Collective on mesh.comm.

    Args:
        materials: those of all bodies, the same on all ranks.
        material: (ncells,), index of that of each local cell.
        layer: (ncells,), number of the material among those of its body, and the number of layers on all ranks: as in
            `NodalStress`; None: bodies have one material each.
        springs: of elastic supports, part of the stiffness, of internal forces and energies; None: there are none.
        stress_free: (ncells, (p+1)^3, 3, 3), stress-free strain at the nodes `cells` [-]; None: 0 on all ranks.

    Attributes:
        quadrature_degree: of the Gauss rule on curved cells, 2p + 1: (p+1)^3 points.
        lame: the two Lame coefficients, constant on cells, of the nearest isotropic material [Pa].
        argument: coefficient in the place of a displacement in an `Integral`; its values are scratch, those of the
            displacement that was integrated last.
        projects: True with nearly incompressible bodies; the energy of a displacement then depends on the cells.

    Raises:
        CompilationError: as `compiled`; also in methods that integrate.
    """

    def __init__(
        self,
        leaf_mesh: LeafMesh,
        materials: Sequence[Material | Orthotropic],
        material: IntArray,
        prolongation: Prolongation,
        stages: Stages,
        layer: tuple[IntArray, int] | None = None,
        springs: Springs | None = None,
        stress_free: FloatArray | None = None,
    ) -> None:
        self._materials, self._layer, self.springs = (materials, material), layer, springs
        super().__init__(leaf_mesh, prolongation)
        self.quadrature_degree = 2 * prolongation.space.degree + 1
        self._stages, constant = stages, fem.functionspace(self.mesh, ("DG", 0))
        self.lame = fem.Function(constant), fem.Function(constant)
        cells, soft = constant.dofmap.list[:, 0], np.array([one.projected for one in materials])
        for lame, values in zip(self.lame, np.array([one.isotropic.lame for one in materials]).T):
            lame.x.array[cells] = values[material]
        orthotropic = any(isinstance(one, Orthotropic) for one in materials)
        self._more = Anisotropy(self.mesh, materials, material) if orthotropic else None
        self._soft, self.projects = soft[material], bool(soft.any())
        if self.projects:
            self._pointwise = fem.Function(constant)
            self._pointwise.x.array[cells] = ~self._soft
            self._projection = VolumeProjection(self.mesh, self.cell_stiffness())
        self._stress_free = None if stress_free is None else self.of_cells(stress_free)
        self.argument = self.blank()
        self._integrals: dict[str, Integral] = {}

    @property
    def stresses(self) -> NodalStress:
        """Fields of stresses by nodal values.  Local.

        Not kept here: a cycle of references would wait for Python's garbage collection, which differs between ranks.
        After ranks have freed different communicators, Open MPI takes milliseconds and more to make one.
        """
        return NodalStress(self, *(self._layer or (np.zeros(len(self.cells), dtype=np.int64), 1)))

    def blank(self) -> DisplacementField:
        """A displacement of zero, without stress-free strain.  Collective."""
        u, stress_free, projected = fem.Function(self.function_space, name="displacement"), None, None
        strain, volume_strain = ufl.sym(ufl.grad(u)), ufl.div(u)
        if self._stress_free is not None:
            stress_free = fem.Function(self._stress_free.function_space)
            strain, volume_strain = strain - stress_free, volume_strain - ufl.tr(stress_free)
        if self.projects:
            projected = fem.Function(self._projection.space)
            volume_strain = self._pointwise * volume_strain + (1 - self._pointwise) * projected
        return DisplacementField(u, strain, volume_strain, projected, stress_free)

    def field(self, conforming: FloatArray, loaded: bool = False) -> DisplacementField:
        """The displacement at all nodes from the owned conforming values (owned, 3) [m].

        Collective.  A displacement of the `loaded` bodies has their stress-free strain, an adjoint solution has none.
        """
        field, argument = self.blank(), self.argument
        field.function.x.array[:] = self.at_blocks(self.prolongation.prolong(conforming))
        if loaded and field.stress_free is not None and self._stress_free is not None:
            field.stress_free.x.array[:] = self._stress_free.x.array
        if field.projected is not None:
            of = ufl.div(argument.function)
            if argument.stress_free is not None:
                of -= ufl.tr(argument.stress_free)
            moments = self._integral("moments", ufl.inner(ufl.TestFunction(self._projection.space), of)).vector(field)
            field.projected.x.array[:] = self._projection.projected(moments)
        return field

    def on(self, prolongation: Prolongation) -> Elasticity:
        """Elasticity of the same bodies with displacements of another degree, on the same forest.  Collective."""
        springs = None if self.springs is None else self.springs.on(prolongation)
        return Elasticity(self.leaf_mesh, *self._materials, prolongation, self._stages, self._layer, springs)

    def stress(self, field: DisplacementField) -> ufl.core.expr.Expr:
        """Cauchy stress [Pa] of a field, a UFL expression.  Local."""
        return self._law(field.strain, field.volume_strain)

    def hooke(self, u: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """Hooke's law: the Cauchy stress [Pa] of a displacement.  Local."""
        return self._law(ufl.sym(ufl.grad(u)), ufl.div(u))

    def _law(self, strain: ufl.core.expr.Expr, volume_strain: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        stress = self.lame[0] * volume_strain * ufl.Identity(3) + 2 * self.lame[1] * strain
        return stress if self._more is None else stress + self._more.stress(strain)

    def work(self, one: ufl.core.expr.Expr, other: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """One stress : C^-1 the other; of one with itself twice the energy density [Pa].  Local."""
        if self._more is not None:
            return self._more.work(one, other)
        first, second = self.lame
        traces = ufl.tr(one) * ufl.tr(other)
        return (ufl.inner(one, other) - first / (3 * first + 2 * second) * traces) / (2 * second)

    def energy_norm(self, conforming: FloatArray) -> float:
        """omega (4) of a displacement (owned, 3) [m], with the energy of springs: [J^(1/2)].  Collective."""
        u = self.argument
        return self._root(self._integral("energy", self._energy(u.function, u.volume_strain**2)), conforming)

    def change_norm(self, conforming: FloatArray) -> float:
        """Energy norm [J^(1/2)] of the difference (owned, 3) [m] of solutions on this mesh and on a coarser one.

        Collective.  Without projected volume strains, which differ on the coarser mesh.
        """
        u = self.argument
        square = self._pointwise * ufl.div(u.function) ** 2 if self.projects else u.volume_strain**2
        energy = self._integral("change" if self.projects else "energy", self._energy(u.function, square))
        return self._root(energy, conforming, springs=False)

    def _energy(self, u: fem.Function, volume_strain2: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """Twice the energy density of a displacement, given the square of its volume strain."""
        strain = ufl.sym(ufl.grad(u))
        energy = 2 * self.lame[1] * ufl.inner(strain, strain) + self.lame[0] * volume_strain2
        return energy if self._more is None else energy + ufl.inner(self._more.stress(strain), strain)

    def _root(self, energy: Integral, conforming: FloatArray, loaded: bool = False, springs: bool = True) -> float:
        field = self.field(conforming, loaded)
        of_springs = (
            0.0 if self.springs is None or not springs else self.springs.energy(self.at_leaves(field.function))
        )
        return float(np.sqrt(max(self.prolongation.comm.allreduce(energy.sum(field) + of_springs), 0.0)))

    def internal_forces(self, field: DisplacementField) -> FloatArray:
        """P^T K u, integrated from the stress of u without a matrix: (owned, 3) [N].  Collective."""
        strain = ufl.sym(ufl.grad(ufl.TestFunction(self.function_space)))
        forces = self._integral("forces", ufl.inner(self.stress(self.argument), strain)).vector(field)
        result = self.prolongation.restrict(self.at_nodes(forces))
        if self.springs is not None:
            result += self.springs.internal_forces(self.at_leaves(field.function))
        return result

    def stress_free_forces(self) -> FloatArray:
        """The load (owned, 3) [N] of the stress-free strain, int C eps_0 : grad v.  Collective."""
        at_rest = np.zeros((self.prolongation.owned, 3))
        return at_rest if self._stress_free is None else -self.internal_forces(self.field(at_rest, loaded=True))

    def restraint_norm(self) -> float:
        """Energy norm [J^(1/2)] of the stress 2 mu eps_0: that of restraint, but for Poisson's ratio.  Collective."""
        if self._stress_free is None:
            return 0.0
        strain = self.argument.strain
        energy = self._integral("restraint", 2 * self.lame[1] * ufl.inner(strain, strain))
        return self._root(energy, np.zeros((self.prolongation.owned, 3)), loaded=True)

    @property
    def mixed(self) -> bool:
        """True if the pressure of nearly incompressible bodies is an unknown: at degree 2, where the pair is stable."""
        return bool(self.projects and self.prolongation.space.degree > 1)

    def stiffness(
        self, rows: Rows | None = None, mixed: bool = False, supports: Supports | None = None
    ) -> BlockMatrix:
        """P^T K P on the conforming unknowns before `mat.assemble`, with room for the blocks of contact rows.

        Collective on mesh.comm.

        Args:
            mixed: without `volume_term`.
            supports: at the owned conforming nodes, to eliminate; None: nothing is eliminated.

        Returns:
            the matrix, with its `held` forces if there are supports.

        Raises:
            SolveError: the matrix would not fit into the memory.
        """
        graph = node_couplings(self.prolongation, self.cells)
        if rows is not None:
            graph = graph + rows.couplings()
        matrix = create_matrix(self.prolongation.comm, graph, self.prolongation.index_map)
        total = CellSum(self.prolongation, matrix, supports)
        hangs = self.prolongation.hanging[self.cells].any(axis=1)
        kernel = self.cell_stiffness(mixed)
        for some in (np.flatnonzero(~hangs), np.flatnonzero(hangs)):
            for part in parts(some, 9 * self.cells.shape[1] ** 2):
                matrices = kernel.matrices(part)
                nodes: IntArray = self.prolongation.conforming[self.cells[part]]
                if hangs[part].any():
                    nodes, weights = cell_constraints(self.prolongation, self.cells[part])
                    matrices = constrained(matrices, weights)
                total.add(matrices, nodes)
        if self.springs is not None:
            self.springs.add_to(total)
        give_back()
        return total.result()

    def measure(self) -> ufl.Measure:
        """Volume of this rank's cells, by the Gauss rule of `quadrature_degree`.  Local."""
        return ufl.Measure("dx", self.mesh, "everywhere", {"quadrature_degree": self.quadrature_degree})

    def _integral(self, name: str, integrand: ufl.core.expr.Expr) -> Integral:
        """Integral of an expression of `argument`, kept by name."""
        if name not in self._integrals:
            with self._stages("compile"):
                form = integrand * self.measure()
                self._integrals[name] = Integral(self.prolongation.comm, form, [self.argument])
        return self._integrals[name]

    def cell_stiffness(self, mixed: bool = False) -> CellStiffness:
        """Stiffness of cells, `mixed`: without `volume_term`.  Local."""
        materials, material = self._materials
        moduli = np.array([one.stiffness for one in materials])
        for number, one in enumerate(materials):
            if one.projected:
                moduli[number] = one.isotropic.lame[1] * np.diag([2.0, 2.0, 2.0, 1.0, 1.0, 1.0])
        first, second = (self._of_cells(lame) for lame in self.lame)
        volume = np.where(self._soft, _first_lame(second) if mixed else first, 0.0)
        return CellStiffness(self.leaf_mesh, self.prolongation.space.degree, moduli, material, volume)

    def volume_term(self, supports: Supports) -> VolumeTerm:
        """The term of the mixed form beside its matrix.  Local."""
        soft, kernel = np.flatnonzero(self._soft), self.cell_stiffness()
        moments = [(self.cells[part], kernel.moments(part)) for part in parts(soft, 9 * self.cells.shape[1] ** 2)]
        each = np.repeat(soft, len(kernel.powers))
        first, second = (self._of_cells(lame)[each] for lame in self.lame)
        in_matrix = _first_lame(second)
        return VolumeTerm(self.prolongation, moments, first - in_matrix, 2 * second + in_matrix, supports)

    def _of_cells(self, lame: fem.Function) -> FloatArray:
        return lame.x.array[lame.function_space.dofmap.list[:, 0]]


def _first_lame(second: FloatArray) -> FloatArray:
    return 2 * MATRIX_POISSON / (1 - 2 * MATRIX_POISSON) * second
