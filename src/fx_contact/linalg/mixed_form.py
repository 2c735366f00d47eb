"""FGMRES for nearly incompressible bodies, whose pressures are unknowns beside the displacement.

K = A + D^T C D is not assembled.  M is a preconditioner of the matrix A, S an approximation of the Schur complement:

    [ A   D^T  ] [u]   [f]                          [ M  D^T ]^-1
    [ D  -C^-1 ] [s] = [0],     preconditioned by   [ 0  -S  ]

Iterations hardly depend on lambda (M. F. Murphy, G. H. Golub, A. J. Wathen, SIAM J. Sci. Comput. 21(6), 2000).  With
the residuals r and q of the rows, as K >= A and K >= D^T C D, the error e of the displacement has

    (e^T K e)^(1/2)  <=  (r^T A^-1 r)^(1/2) + |C^(1/2) q|  ~  |r|_M + |C^(1/2) q|.

FGMRES goes on until that bound is at most tol omega(u), or rounding.
"""

from abc import abstractmethod

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fx_contact.linalg.krylov import KrylovSolver, Outcome
from fx_contact.linalg.operator import Array, Equations, Operator, Sum
from fx_contact.linalg.p_multigrid import CoarseLevel
from fx_contact.linalg.petsc_objects import PetscObjects
from fx_contact.linalg.petsc_options import PetscOptions
from fx_contact.linalg.preconditioner import ProjectedPreconditioner
from fx_contact.linalg.stopping import EnergyNorm, StoppingRule

#: Iterations after which FGMRES restarts: more than it takes but on flat cells.  Each keeps two vectors, so that a
#: hundred take 200 * 8 * 28 / 24 = 1.9 kB an unknown, about as much as the matrix.
_RESTART = 100


class PressureOperator(Operator):
    """D^T C D, the part of the stiffness that a matrix A lacks.

    Attributes:
        comm: of the run.
        missing: (m,), C [Pa].
        schur: (m,), S^-1 [Pa].
    """

    comm: MPI.Comm
    missing: Array
    schur: Array

    def __len__(self) -> int:
        return len(self.missing)

    @abstractmethod
    def strains(self, u: Array) -> Array:
        """D u of (owned, 3) [m]: (m,) [m^(3/2)].  Collective."""

    @abstractmethod
    def forces(self, pressure: Array) -> Array:
        """D^T s of (m,) [Pa m^(3/2)]: (owned, 3) [N], 0 in held directions.  Collective."""

    @abstractmethod
    def forces_of_held(self, u: Array) -> Array:
        """D^T C D of the prescribed components of (owned, 3) [m]: (owned, 3) [N], 0 in held directions.  Collective."""

    @abstractmethod
    def add_to(self, mat: PETSc.Mat) -> None:
        """Add it to a matrix that has the entries of K, except in held directions.  Collective."""

    def add_product(self, u: Array, y: Array) -> None:
        """As `Operator.add_product`."""
        y += self.forces(self.missing * self.strains(u))


class FlexibleGmres:
    """FGMRES on displacement and pressure, stopped by the bound of the error in the energy norm.

    Unknowns are (u, s); rows are scaled by diag(A)^(-1/2) and C^(1/2), to the unit J^(1/2).

    Collective.

    Args:
        krylov: from `create`.
        stiffness: A, symmetric positive definite.
        matrix: A or close to it, for the preconditioner.
        volume: D and C.
        energy_norm: omega (4), of K.
        objects: free what is made here.

    Attributes:
        matrix: as given.
        preconditioner: of the matrix.
    """

    @classmethod
    def create(cls, comm: MPI.Comm, options: PetscOptions, objects: PetscObjects) -> KrylovSolver:
        """The KSP of this method.  Collective on comm."""
        krylov = KrylovSolver(comm, options, objects, ("fgmres",), PETSc.KSP.NormType.UNPRECONDITIONED)
        krylov.ksp.setGMRESRestart(_RESTART)
        return krylov

    def __init__(
        self,
        krylov: KrylovSolver,
        stiffness: Operator,
        matrix: PETSc.Mat,
        volume: PressureOperator,
        energy_norm: EnergyNorm,
        objects: PetscObjects,
    ) -> None:
        self.matrix, self.preconditioner = matrix, krylov.preconditioner
        self._krylov, self._stiffness, self._volume, self._energy_norm = krylov, stiffness, volume, energy_norm
        self._operator = Sum([stiffness])
        self._forces, self._displacement, rest = (objects.add(matrix.createVecRight()) for _ in range(3))
        self._projected = ProjectedPreconditioner(krylov.preconditioner, rest)
        self._size = matrix.getLocalSize()[0]
        size = self._size + len(volume)
        self._x, self._b = krylov.connect(size, self._product, self._precondition, self._projected.view)
        self._pressure: Array = np.zeros(len(volume))
        self._weight = np.sqrt(volume.missing)
        self._root: Array  # of diag A, (owned, 3)
        self._rule: StoppingRule

    def set_up(self, coarse: CoarseLevel | None) -> None:
        """As `ConjugateGradients.set_up`."""
        self.preconditioner.set_up(self.matrix, coarse)
        self._root = np.sqrt(np.abs(self._stiffness.diagonal()))
        diagonal = Sum([self._stiffness, self._volume]).diagonal()
        self._rule = StoppingRule(self._krylov.comm, self._energy_norm, diagonal)

    def residual(self, equations: Equations, u: Array) -> Array:
        """The residual forces of the last displacement with its pressure, (owned, 3) [N]."""
        return equations.residual(self._stiffness, u) - self._volume.forces(self._pressure)

    def solve(self, equations: Equations, u: Array, tolerance: float, most: int) -> Outcome:
        """As `ConjugateGradients.solve`.

        The bound takes a preconditioner: it is computed where the residual suggests that it is met.
        """
        self._operator = Sum([self._stiffness, equations.term])
        self._projected.projector = equations.projector
        strains = self._volume.strains(u)
        self._pressure = self._first_pressure(strains)
        residual = self.residual(equations, u), self._pressure / self._volume.missing - strains
        reasons, next_check, allowed = PETSc.KSP.ConvergedReason, np.inf, np.nan

        def converged(ksp: PETSc.KSP, count: int, norm: float) -> int:
            """PETSc's reason to end, or to go on."""
            nonlocal next_check, allowed
            if norm > next_check:
                return reasons.DIVERGED_MAX_IT if count >= most else reasons.ITERATING
            bound = self._bound(_array(ksp.buildResidual()))
            change, _ = self._parts(_array(ksp.buildSolution()))
            allowed = self._rule.allowed(u + change, tolerance)
            if bound <= allowed:
                return reasons.CONVERGED_RTOL
            next_check = norm * min(allowed / bound + tolerance, 0.5)
            return reasons.ITERATING

        self._krylov.ksp.setConvergenceTest(converged)
        self._b.array[:] = self._scaled(*residual)
        reason, count = self._krylov.solve(self._b, self._x)
        change, more = self._parts(self._x.array.copy())
        self._pressure = self._pressure + more
        return Outcome(u + change, reason, count, allowed)

    def _first_pressure(self, strains: Array) -> Array:
        """The pressure of the last solution if it fits the strains better than none does."""
        left = self._weight * (strains - self._pressure / self._volume.missing), self._weight * strains
        with_it, without = self._volume.comm.allreduce(np.array([part @ part for part in left]))
        return self._pressure if with_it < without else np.zeros_like(self._pressure)

    def _scaled(self, forces: Array, strains: Array) -> Array:
        """Residuals [N], [m^(3/2)] as rows; forces are changed."""
        projector = self._projected.projector
        if projector is not None and projector.rigid:
            projector.apply_transpose(forces)
        return np.concatenate([(forces / self._root).ravel(), self._weight * strains])

    def _unscaled(self, rows: Array) -> tuple[Array, Array]:
        """The inverse of `_scaled`."""
        forces, strains = self._parts(rows)
        return forces * self._root, strains / self._weight

    def _parts(self, values: Array) -> tuple[Array, Array]:
        """Displacement (owned, 3) and pressure (m,) of unknowns."""
        return values[: self._size].reshape(-1, 3), values[self._size :]

    def _product(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        u, pressure = self._parts(x.array_r)
        forces = self._volume.forces(pressure)
        self._operator.add_product(u, forces)
        y.array[:] = self._scaled(forces, self._volume.strains(u) - pressure / self._volume.missing)

    def _precondition(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """The unknowns that solve the block triangular system."""
        forces, strains = self._unscaled(x.array_r)
        pressure = -self._volume.schur * strains
        displacement = self._inverse(forces - self._volume.forces(pressure))
        y.array[:] = np.concatenate([displacement.ravel(), pressure])

    def _bound(self, rows: Array) -> float:
        """|r|_M + |C^(1/2) q| of a residual [J^(1/2)]."""
        forces, strains = self._unscaled(rows)
        squares = (forces * self._inverse(forces)).sum(), self._volume.missing @ strains**2
        sums = self._volume.comm.allreduce(np.array(squares))
        return float(np.sqrt(np.maximum(sums, 0.0)).sum())

    def _inverse(self, forces: Array) -> Array:
        """M^-1 of forces, which the next call overwrites."""
        self._forces.array[:] = forces.ravel()
        self._projected.apply(self._forces, self._displacement)
        return self._displacement.array.reshape(-1, 3)


def _array(vector: PETSc.Vec) -> Array:
    """The values of a Vec that is destroyed."""
    values: Array = vector.array.copy()
    vector.destroy()
    return values
