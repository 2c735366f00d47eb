"""Error estimate of O. C. Zienkiewicz, J. Z. Zhu (1987): indicator (3), energies (4), and products of two errors.

At degree 2 the larger of (3) and of the element residual counts in each cell: (3) shows jumps from cell to cell, as
beside contact edges, the element residual smooth errors.  Effectivities: `studies/effectivity`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from ufl.core.expr import Expr

from fx_contact.estimate.element_residual import ElementResidual
from fx_contact.estimate.shear_free import ShearFree
from fx_contact.estimate.stress_recovery import StressRecovery
from fx_contact.fem.displacement_field import DisplacementField, Integral
from fx_contact.fem.elasticity import Elasticity
from fx_contact.fem.space import child_error
from fx_contact.items.materials import TENSOR
from fx_contact.parallel.arrays import BoolArray, FloatArray
from fx_contact.parallel.errors import SolveError
from fx_contact.parallel.timing import Stages


@dataclass(frozen=True, eq=False)
class Estimate:
    """Estimated error and energy of a displacement field.

    Attributes:
        error: (ncells,), xi_T (3) [J^(1/2)].
        energy: (ncells,), twice the strain energy [J]; None: not kept.
        error_global: xi of all cells (6) [J^(1/2)].
        energy_norm: omega (4) of the stress, or the least one that counts [J^(1/2)].
        cells: number of cells on all ranks.
        child_error: `fem.space.child_error`, xi_T^2 of a child over that of its parent if the solution is smooth [-].
        at_edge: (ncells,), cells where contact ends, as `contact_edge.cells_at_edge`; None: not known.
    """

    error: FloatArray
    energy: FloatArray | None
    error_global: float
    energy_norm: float
    cells: int
    child_error: float
    at_edge: BoolArray | None = None

    @property
    def relative(self) -> float:
        """xi / omega [-]."""
        return self.error_global / self.energy_norm if self.energy_norm else 0.0


@dataclass(frozen=True, eq=False)
class DisplacementError:
    """Estimated error e of a displacement field.

    Attributes:
        stress: sigma*, six components a node [Pa].
        squares: (k, ncells), xi_T^2 by (3) and, at degree 2, by the element residual [J].
        residual: (ncells, 9), element residual [J/m]; None at degree 1.
        bubbles: (ncells, 9), its solution [m]; None at degree 1.
    """

    field: DisplacementField
    stress: fem.Function
    squares: FloatArray
    residual: FloatArray | None
    bubbles: FloatArray | None
    estimate: Estimate


class Estimator:
    """Errors of displacements on a mesh.

    Collective.

    Args:
        body_force: UFL vector on the mesh [N/m^3]; None: 0.
    """

    def __init__(
        self, elasticity: Elasticity, shear_free: ShearFree, stages: Stages, body_force: Expr | None = None
    ) -> None:
        self._elasticity, self._comm, self._stages = elasticity, elasticity.prolongation.comm, stages
        self._recovery = StressRecovery(elasticity, shear_free, stages)
        self._arguments = elasticity.argument, fem.Function(elasticity.stresses.space(6))
        sigma, off = elasticity.stress(elasticity.argument), self._off(*self._arguments)
        self._energies = self._compiled([elasticity.work(off, off), elasticity.work(sigma, sigma)], self._arguments)
        self._product: Integral | None = None
        even = elasticity.prolongation.space.degree % 2 == 0
        self._residual = ElementResidual(elasticity, body_force, stages) if even else None

    def error(
        self, field: DisplacementField, noise: float = 0.0, loaded: bool = True, least: float = 0.0
    ) -> DisplacementError:
        """The estimated error of a displacement.

        Collective.

        Args:
            noise: energy norm up to which the displacement is a rigid motion, without error [J^(1/2)].
            loaded: the body force acts; not on an adjoint solution.
            least: energy norm of the stress that counts [J^(1/2)].

        Raises:
            SolveError: the energy is not a finite number.
        """
        stress, residual, bubbles = self._recovery.stress(field), None, None
        squares, energy = np.maximum(self._energies.vector(field, stress).reshape(-1, 2), 0).T
        squares = squares[None]
        if self._residual is not None:
            residual, bubbles = self._residual.of(field, loaded)
            squares = np.stack([squares[0], (residual * bubbles).sum(axis=1)])
        error2 = squares.max(axis=0)
        total = self._comm.allreduce(np.array([error2.sum(), energy.sum(), len(error2)]), op=MPI.SUM)
        if not np.isfinite(total).all():
            raise SolveError("the strain energy is not a finite number: check the units of moduli and lengths")
        xi, omega = float(np.sqrt(total[0])), max(float(np.sqrt(total[0] + total[1])), least)
        if omega <= noise:
            squares, error2, energy, xi, omega = 0 * squares, 0 * error2, 0 * energy, 0.0, 0.0
        estimate = Estimate(
            error=np.sqrt(error2),
            energy=energy,
            error_global=xi,
            energy_norm=omega,
            cells=int(total[2]),
            child_error=child_error(self._elasticity.prolongation.space.degree),
        )
        return DisplacementError(field, stress, squares, residual, bubbles, estimate)

    def products(self, one: DisplacementError, other: DisplacementError) -> FloatArray:
        """Products (e_u, e_z)_T of the errors of two displacements: (ncells,) [J].

        Collective.  int_T (sigma*_u - sigma_u) : C^-1 (sigma*_z - sigma_z) by (3), r_u K^-1 r_z by the residual; at
        degree 2 that with the larger product of norms.  (e_u, e_u)_T = xi_T^2, |(e_u, e_z)_T| <= xi_T(u) xi_T(z).
        """
        if self._product is None:
            more = self._elasticity.blank(), fem.Function(self._elasticity.stresses.space(6))
            work = self._elasticity.work(self._off(*self._arguments), self._off(*more))
            self._product = self._compiled([work], [*self._arguments, *more])
        result = self._product.vector(one.field, one.stress, other.field, other.stress)
        if one.residual is not None and other.bubbles is not None:
            recovered, residual = one.squares * other.squares
            result = np.where(recovered >= residual, result, (one.residual * other.bubbles).sum(axis=1))
        return result

    def _off(self, field: DisplacementField, stress: fem.Function) -> Expr:
        """sigma* - sigma_h."""
        recovered = ufl.as_matrix([[stress[component] for component in row] for row in TENSOR])
        return recovered - self._elasticity.stress(field)

    def _compiled(self, densities: list[Expr], arguments: Sequence[DisplacementField | fem.Function]) -> Integral:
        """Integrals of densities over each cell."""
        test = ufl.TestFunction(fem.functionspace(self._elasticity.mesh, ("DG", 0, (len(densities),))))
        with self._stages("compile"):
            form = ufl.inner(ufl.as_vector(densities), test) * self._elasticity.measure()
            return Integral(self._comm, form, arguments)
