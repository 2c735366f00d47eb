"""FGMRES for nearly incompressible bodies, whose pressures are unknowns beside the displacement.

K = A + D^T C D is not assembled.  M is a preconditioner of the matrix A, S an approximation of the Schur complement:

    [ A   D^T  ] [u]   [f]                          [ M  D^T ]^-1
    [ D  -C^-1 ] [s] = [0],     preconditioned by   [ 0  -S  ]

Iterations hardly depend on lambda (M. F. Murphy, G. H. Golub, A. J. Wathen, SIAM J. Sci. Comput. 21(6), 2000).  As
K >= A and K >= D^T C D, the residuals r and q of the rows bound the error e of the displacement:

    (e^T K e)^(1/2)  <=  (r^T A^-1 r)^(1/2) + |C^(1/2) q|  ~  |r|_M + |C^(1/2) q|.

FGMRES stops when this bound is at most tol omega(u), or rounding.
"""

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fx_contact.linalg.krylov import KrylovMethod, Outcome
from fx_contact.linalg.operator import Equations, Operator, PressureOperator
from fx_contact.linalg.p_multigrid import CoarseLevel
from fx_contact.linalg.petsc_objects import PetscObjects, PetscOptions
from fx_contact.linalg.stopping import EnergyNorm
from fx_contact.parallel.arrays import FloatArray

#: Iterations after which FGMRES restarts: more than it needs except on flat cells.  With two vectors of 28 / 24
#: entries an unknown for each iteration it needs 200 * 8 * 28 / 24 = 1.9 kB an unknown.
_RESTART = 100
#: Pressures of the last solutions that a first guess combines: of a displacement, and of its derivatives by distances
#: of obstacles; and squared cosines of their angles from which on they count as alike.
_KEPT, _ALIKE = 4, 1e-10


class FlexibleGmres(KrylovMethod):
    """FGMRES on displacement and pressure (u, s).

    Collective.  Rows are scaled by diag(A)^(-1/2) and C^(1/2), to the unit J^(1/2); the energy norm is that of K.
    """

    METHODS = ("fgmres",)
    NORM = PETSc.KSP.NormType.UNPRECONDITIONED

    def __init__(
        self,
        options: PetscOptions,
        stiffness: Operator,
        matrix: PETSc.Mat,
        energy_norm: EnergyNorm,
        objects: PetscObjects,
        volume: PressureOperator,
    ) -> None:
        super().__init__(options, stiffness, matrix, energy_norm, objects, len(volume))
        self._ksp.setGMRESRestart(_RESTART)
        self._volume = volume
        self._forces, self._displacement = (objects.add(matrix.createVecRight()) for _ in range(2))
        self._pressure: FloatArray = np.zeros(len(volume))
        self._pressures: list[FloatArray] = []
        self._weight = np.sqrt(volume.missing)
        self._root: FloatArray  # of diag A, (owned, 3)

    def set_up(self, coarse: CoarseLevel | None) -> None:
        """As `KrylovMethod.set_up`."""
        super().set_up(coarse)
        self._root = np.sqrt(np.abs(self._stiffness.diagonal()))

    def residual(self, equations: Equations, u: FloatArray) -> FloatArray:
        """As `KrylovMethod.residual`, with the pressure of the last solution."""
        return super().residual(equations, u) - self._volume.forces(self._pressure)

    def solve(self, equations: Equations, u: FloatArray, tolerance: float, most: int) -> Outcome:
        """As `KrylovMethod.solve`.  The bound costs a product with M^-1 and is computed at small residuals only."""
        self._begin(equations)
        self._b.array[:] = self._first_residual(equations, u)
        reasons, next_check, allowed = PETSc.KSP.ConvergedReason, np.inf, np.nan

        def converged(ksp: PETSc.KSP, count: int, norm: float) -> int:
            """PETSc's reason, by the bound of the error."""
            nonlocal next_check, allowed
            if norm > next_check:
                return reasons.DIVERGED_MAX_IT if count >= most else reasons.ITERATING
            bound = self._bound(_array(ksp.buildResidual()))
            change, _ = self._parts(_array(ksp.buildSolution()))
            allowed = self.rule.allowed(u + change, tolerance)
            if bound <= allowed:
                return reasons.CONVERGED_RTOL
            next_check = norm * min(allowed / bound + tolerance, 0.5)
            return reasons.ITERATING

        self._ksp.setConvergenceTest(converged)
        reason, count = self._solved()
        change, more = self._parts(self._x.array.copy())
        self._pressure = self._pressure + more
        self._pressures = [*self._pressures[1 - _KEPT :], self._pressure]
        return Outcome(u + change, reason, count, allowed)

    def _first_residual(self, equations: Equations, u: FloatArray) -> FloatArray:
        """The least scaled residual for combinations of the last pressures, which `_pressure` becomes."""
        self._pressure = np.zeros_like(self._pressure)
        residual = self._scaled(self.residual(equations, u), -self._volume.strains(u))
        if self._pressures:
            past = np.stack(self._pressures)
            images = np.stack([self._scaled(self._volume.forces(s), -s / self._volume.missing) for s in past])
            sums = np.column_stack([images @ images.T, images @ residual])
            self._volume.comm.Allreduce(MPI.IN_PLACE, sums)
            part = np.linalg.lstsq(sums[:, :-1], sums[:, -1], rcond=_ALIKE)[0]
            self._pressure, residual = part @ past, residual - part @ images
        return residual

    def _scaled(self, forces: FloatArray, strains: FloatArray) -> FloatArray:
        """Residuals [N], [m^(3/2)] as rows; the forces are projected in place."""
        projector = self._projected.projector
        if projector is not None and projector.rigid:
            projector.apply_transpose(forces)
        return np.concatenate([(forces / self._root).ravel(), self._weight * strains])

    def _unscaled(self, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        forces, strains = self._parts(rows)
        return forces * self._root, strains / self._weight

    def _parts(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        return values[: self._size].reshape(-1, 3), values[self._size :]

    def _product(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        u, pressure = self._parts(x.array_r)
        forces = self._volume.forces(pressure)
        self._operator.add_product(u, forces)
        y.array[:] = self._scaled(forces, self._volume.strains(u) - pressure / self._volume.missing)

    def _precondition(self, _: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        forces, strains = self._unscaled(x.array_r)
        pressure = -self._volume.schur * strains
        displacement = self._inverse(forces - self._volume.forces(pressure))
        y.array[:] = np.concatenate([displacement.ravel(), pressure])

    def _bound(self, rows: FloatArray) -> float:
        """|r|_M + |C^(1/2) q| of a residual [J^(1/2)]."""
        forces, strains = self._unscaled(rows)
        squares = (forces * self._inverse(forces)).sum(), self._volume.missing @ strains**2
        sums = self._volume.comm.allreduce(np.array(squares))
        return float(np.sqrt(np.maximum(sums, 0.0)).sum())

    def _inverse(self, forces: FloatArray) -> FloatArray:
        """M^-1 of forces, which the next call overwrites."""
        self._forces.array[:] = forces.ravel()
        self._projected.apply(self._forces, self._displacement)
        return self._displacement.array.reshape(-1, 3)


def _array(vector: PETSc.Vec) -> FloatArray:
    """The values of a Vec that is destroyed."""
    values: FloatArray = vector.array.copy()
    vector.destroy()
    return values
