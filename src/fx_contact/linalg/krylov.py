"""PETSc's Krylov methods on an `Operator` and a preconditioner; conjugate gradients in the natural norm."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fx_contact.linalg.operator import Array, Equations, Operator, Sum
from fx_contact.linalg.p_multigrid import CoarseLevel
from fx_contact.linalg.petsc_objects import PetscObjects, petsc_errors
from fx_contact.linalg.petsc_options import PetscOptions
from fx_contact.linalg.preconditioner import Preconditioner, ProjectedPreconditioner
from fx_contact.linalg.stopping import EnergyNorm, StoppingRule
from fx_contact.parallel.errors import SolveError

#: PETSc options that would undo what the solver states of its error, and what to set instead.
RESERVED = set(
    "ksp_rtol ksp_atol ksp_divtol ksp_max_it ksp_convergence_test ksp_converged_maxits ksp_error_if_not_converged "
    "ksp_initial_guess_nonzero ksp_norm_type ksp_pc_side".split()
)
INSTEAD = (
    "set Solver.tolerance, Solver.loose_tolerance or Solver.max_krylov, which hold for the error in the energy norm"
)
#: Preconditioners that are no inverse of the matrix, so that the natural norm is not that of the energy, and one that
#: needs the entries of the operator, which may have a term beside its matrix.
_UNFIT = (PETSc.PC.Type.NONE, PETSc.PC.Type.MAT, PETSc.PC.Type.LMVM, PETSc.PC.Type.EISENSTAT)
#: The residual may grow: that of a good first guess is small against those of the first iterations.
_NO_LIMIT = 1e30
#: Most runs of PCG in one solve, where the first guess has more energy than the solution.
_RUNS = 3

_Callback = Callable[[PETSc.Vec, PETSc.Vec], None]


@dataclass(frozen=True, eq=False)
class Outcome:
    """The end of some iterations.

    Attributes:
        displacement: (owned, 3), the solution, or the last iterate of a method that has not converged [m].
        reason: of PETSc for the end, negative for a failure.
        iterations: number of them.
        error: bound of the error of a solution in the energy norm [J^(1/2)].
    """

    displacement: Array
    reason: int
    iterations: int
    error: float


class KrylovSolver:
    """A KSP of PETSc whose operator and preconditioner are called back.

    Collective on comm.

    Args:
        comm: of the run.
        options: of the method and its preconditioner.
        objects: free what is made here.
        methods: allowed values of `ksp_type`, the first by default.
        norm: PETSc's KSP.NormType.

    Attributes:
        ksp: PETSc KSP.
        preconditioner: Preconditioner of a matrix, of the type that the options have.

    Raises:
        SolveError: options that PETSc cannot work with, or a method or preconditioner whose error is not that in the
            energy norm.
    """

    def __init__(
        self, comm: MPI.Comm, options: PetscOptions, objects: PetscObjects, methods: tuple[str, ...], norm: int
    ) -> None:
        self.comm, self._options, self._objects = comm, options, objects
        self.preconditioner = Preconditioner(comm, options, objects)
        self.ksp = ksp = objects.add(PETSc.KSP().create(comm))
        ksp.setPC(self.preconditioner.pc)
        ksp.setOptionsPrefix(options.prefix)
        ksp.setType(methods[0])
        ksp.setNormType(norm)
        ksp.setConvergenceHistory(1, reset=True)
        with options.there(), petsc_errors(comm, options.prefix, objects):
            ksp.setFromOptions()
        kind = self.preconditioner.pc.getType()
        if ksp.getType() not in methods or kind in _UNFIT:
            raise SolveError(
                f"-{options.prefix}ksp_type {ksp.getType()} -{options.prefix}pc_type {kind} cannot be "
                f"used: the method must be one of {', '.join(methods)}, which stop by the energy norm, and the "
                f"preconditioner an inverse of the matrix alone, not {', '.join(_UNFIT)}: jacobi is as simple"
            )

    def connect(
        self, size: int, product: _Callback, apply: _Callback, view: Callable[[PETSc.Viewer], None]
    ) -> list[PETSc.Vec]:
        """Iterate on an operator and a preconditioner from now on.

        Args:
            size: unknowns of this rank.
            product, apply: of x, y: let y be the product with the operator, or the preconditioner.
            view: write the preconditioner.

        Returns:
            Vec of the solution and of the right-hand side.
        """
        sizes = ((size, PETSc.DETERMINE),) * 2
        operator = self._objects.add(PETSc.Mat().createPython(sizes, _Shell(product), self.comm))
        outer = self._objects.add(PETSc.PC().createPython(_Shell(apply, view), self.comm))
        outer.setOperators(operator, operator)
        self.ksp.setPC(outer)
        self.ksp.setOperators(operator, operator)
        return [self._objects.add(vector) for vector in operator.createVecs()]

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> tuple[int, int]:
        """Solve from zero: PETSc's reason for the end, negative for a failure, and the number of iterations."""
        with petsc_errors(self.comm, self._options.prefix, self._objects):
            self.ksp.solve(b, x)
        reason = self.ksp.getConvergedReason()
        if reason > 0 and not np.isfinite(x.norm()):
            reason = PETSc.KSP.ConvergedReason.DIVERGED_NANORINF
        return reason, self.ksp.getIterationNumber()


class ConjugateGradients:
    """PCG, stopped by the energy norm of the error.

    Collective.

    Args:
        krylov: from `create`.
        stiffness: A, symmetric positive definite.
        matrix: A or close to it, for the preconditioner.
        energy_norm: omega (4), of A.
        objects: free what is made here.

    Attributes:
        matrix: as given.
        preconditioner: of the matrix.
    """

    #: Methods that PETSc has in the natural norm.
    METHODS = ("cg", "fcg", "groppcg", "pipecg", "pipefcg")

    @classmethod
    def create(cls, comm: MPI.Comm, options: PetscOptions, objects: PetscObjects) -> KrylovSolver:
        """The KSP of this method.  Collective on comm."""
        return KrylovSolver(comm, options, objects, cls.METHODS, PETSc.KSP.NormType.NATURAL)

    def __init__(
        self,
        krylov: KrylovSolver,
        stiffness: Operator,
        matrix: PETSc.Mat,
        energy_norm: EnergyNorm,
        objects: PetscObjects,
    ) -> None:
        self.matrix, self.preconditioner = matrix, krylov.preconditioner
        self._krylov, self._stiffness, self._energy_norm = krylov, stiffness, energy_norm
        self._operator = Sum([stiffness])
        self._projected = ProjectedPreconditioner(krylov.preconditioner, objects.add(matrix.createVecRight()))
        size = matrix.getLocalSize()[0]
        self._x, self._b = krylov.connect(size, self._product, self._projected.apply, self._projected.view)
        self._rule: StoppingRule

    def _product(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        y.set(0.0)
        self._operator.add_product(x.array_r.reshape(-1, 3), y.array.reshape(-1, 3))

    def set_up(self, coarse: CoarseLevel | None) -> None:
        """Build the preconditioner for the present values of the matrix."""
        self.preconditioner.set_up(self.matrix, coarse)
        self._rule = StoppingRule(self._krylov.comm, self._energy_norm, self._stiffness.diagonal())

    def residual(self, equations: Equations, u: Array) -> Array:
        """The residual forces of a displacement, (owned, 3) [N]."""
        return equations.residual(self._stiffness, u)

    def solve(self, equations: Equations, u: Array, tolerance: float, most: int) -> Outcome:
        """Iterate from a first guess (owned, 3) [m], so many times at most.

        Raises:
            SolveError: an energy norm that is not finite.
        """
        x, b, ksp, count = self._x, self._b, self._krylov.ksp, 0
        self._operator = Sum([self._stiffness, equations.term])
        self._projected.projector = equations.projector
        error = self._rule.begin(u, tolerance)
        for _ in range(_RUNS):
            allowed = error.allowed(u)
            b.array[:] = self.residual(equations, u).ravel()
            ksp.setTolerances(rtol=tolerance, atol=allowed, divtol=_NO_LIMIT, max_it=most)
            reason, iterations = self._krylov.solve(b, x)
            count += iterations
            if reason > 0 or reason == PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT:
                u = u + x.array_r.reshape(-1, 3)
            if reason < 0:
                break
            history = ksp.getConvergenceHistory()
            first = float(history[0]) if len(history) else np.nan
            moved = float(np.sqrt(max(b.dot(x), 0.0)))  # |u - u_0|_A
            if error.is_met(u, first, moved):
                break
        return Outcome(u, reason, count, error.value)


class _Shell:
    """An operator or a preconditioner, as PETSc calls it."""

    def __init__(self, product: _Callback, view: Callable[[PETSc.Viewer], None] | None = None) -> None:
        self._product, self._view = product, view

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """y := A x."""
        self._product(x, y)

    def apply(self, _: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """y := M^-1 x."""
        self._product(x, y)

    def view(self, _: PETSc.Object, viewer: PETSc.Viewer) -> None:
        """The text of `-fx_ksp_view`."""
        if self._view is not None:
            self._view(viewer)
