"""PETSc's Krylov methods on an `Operator` and a preconditioner; conjugate gradients in the natural norm."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
from petsc4py import PETSc

from fx_contact.linalg.operator import Equations, Operator, Sum
from fx_contact.linalg.p_multigrid import CoarseLevel
from fx_contact.linalg.petsc_objects import PetscObjects, PetscOptions, petsc_errors
from fx_contact.linalg.preconditioner import Preconditioner, ProjectedPreconditioner
from fx_contact.linalg.stopping import EnergyNorm, StoppingRule
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import SceneError, SolveError

#: PETSc options that would change the stopping rule.
_RESERVED = set(
    "ksp_rtol ksp_atol ksp_divtol ksp_max_it ksp_convergence_test ksp_converged_maxits ksp_error_if_not_converged "
    "ksp_initial_guess_nonzero ksp_norm_type ksp_pc_side".split()
)
#: Preconditioners that do not approximate the inverse of the matrix: their natural norm is not that of the energy.
#: The last one needs the entries of the operator, which may have a term beside its matrix.
_UNFIT = (PETSc.PC.Type.NONE, PETSc.PC.Type.MAT, PETSc.PC.Type.LMVM, PETSc.PC.Type.EISENSTAT)
#: Allowed growth of the residual: that of a good first guess is small against those of the first iterations.
_NO_LIMIT = 1e30
#: Most runs of PCG in one solve; it restarts after a first guess with more energy than the solution.
_RUNS = 3


@dataclass(frozen=True, eq=False)
class Outcome:
    """Last iterate (owned, 3) [m], PETSc's reason (negative: failure), and a bound of the energy error [J^(1/2)]."""

    displacement: FloatArray
    reason: int
    iterations: int
    error: float


class KrylovMethod(ABC):
    """A KSP of PETSc for `Equations`, by default the first of the methods, stopped by omega (4) of the error.

    Collective.  The stiffness A is symmetric positive definite; the matrix of the preconditioner is A or close to it.
    `pressures` is the number of this rank's unknowns beside the displacement.

    Raises:
        SceneError: an option is reserved.
        SolveError: PETSc rejects the options, or a method or preconditioner does not measure the energy norm.
    """

    METHODS: ClassVar[tuple[str, ...]]  # allowed values of `ksp_type`
    NORM: ClassVar[int]  # PETSc's KSP.NormType

    def __init__(
        self,
        options: PetscOptions,
        stiffness: Operator,
        matrix: PETSc.Mat,
        energy_norm: EnergyNorm,
        objects: PetscObjects,
        pressures: int = 0,
    ) -> None:
        self._comm, self._prefix, self._objects = options.comm, options.prefix, objects
        self.preconditioner = Preconditioner(options, objects)
        self._ksp = self._created(options)
        self._matrix, self._stiffness, self._energy_norm = matrix, stiffness, energy_norm
        self._operator = self._full = Sum([stiffness])
        self._size = matrix.getLocalSize()[0]
        self._projected = ProjectedPreconditioner(self.preconditioner, objects.add(matrix.createVecRight()))
        sizes = ((self._size + pressures, PETSc.DETERMINE),) * 2
        product = SimpleNamespace(mult=self._product)
        operator = objects.add(PETSc.Mat().createPython(sizes, product, self._comm))
        inverse = SimpleNamespace(apply=self._precondition, view=self._projected.view)
        outer = objects.add(PETSc.PC().createPython(inverse, self._comm))
        outer.setOperators(operator, operator)
        self._ksp.setPC(outer)
        self._ksp.setOperators(operator, operator)
        self._x, self._b = map(objects.add, operator.createVecs())
        self.rule: StoppingRule

    def _created(self, options: PetscOptions) -> PETSc.KSP:
        for name in sorted(_RESERVED & options.of_user.keys()):
            raise SceneError(
                f"the PETSc option {name!r} (on the command line -{options.prefix}{name}) is not the user's: set "
                "Solver.tolerance, Solver.loose_tolerance or Solver.max_krylov, for the error in the energy norm"
            )
        ksp = self._objects.add(PETSc.KSP().create(self._comm))
        ksp.setPC(self.preconditioner.pc)
        ksp.setOptionsPrefix(options.prefix)
        ksp.setType(self.METHODS[0])
        ksp.setNormType(self.NORM)
        ksp.setConvergenceHistory(1, reset=True)
        with options.reading(self._objects):
            ksp.setFromOptions()
        kind = self.preconditioner.pc.getType()
        if ksp.getType() not in self.METHODS or kind in _UNFIT:
            raise SolveError(
                f"-{options.prefix}ksp_type {ksp.getType()} -{options.prefix}pc_type {kind} cannot be "
                f"used: the method must be one of {', '.join(self.METHODS)}, which stop by the energy norm, and the "
                f"preconditioner an inverse of the matrix alone, not {', '.join(_UNFIT)}: jacobi is as simple"
            )
        return ksp

    def set_up(self, coarse: CoarseLevel | None) -> None:
        """Build the preconditioner for the present values of the matrix."""
        self.preconditioner.set_up(self._matrix, coarse)
        self.rule = StoppingRule(self._comm, self._energy_norm, self._full.diagonal())

    def residual(self, equations: Equations, u: FloatArray) -> FloatArray:
        """The residual forces of the last solution, (owned, 3) [N]."""
        return equations.residual(self._stiffness, u)

    def _begin(self, equations: Equations) -> None:
        self._operator = Sum([self._stiffness, equations.term])
        self._projected.projector = equations.projector

    @abstractmethod
    def _product(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None: ...

    def _precondition(self, _: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        self._projected.apply(x, y)

    @abstractmethod
    def solve(self, equations: Equations, u: FloatArray, tolerance: float, most: int) -> Outcome:
        """Iterate from a first guess (owned, 3) [m], at most so many times.  Raises SolveError as `StoppingRule`."""

    def _solved(self) -> tuple[int, int]:
        """Solve for `_x` from zero: PETSc's convergence reason, and the number of iterations."""
        with petsc_errors(self._comm, self._prefix, self._objects):
            self._ksp.solve(self._b, self._x)
        reason = self._ksp.getConvergedReason()
        if reason > 0 and not np.isfinite(self._x.norm()):
            reason = PETSc.KSP.ConvergedReason.DIVERGED_NANORINF
        return reason, self._ksp.getIterationNumber()


class ConjugateGradients(KrylovMethod):
    """PCG, in the natural norm."""

    METHODS = ("cg", "fcg", "groppcg", "pipecg", "pipefcg")
    NORM = PETSc.KSP.NormType.NATURAL

    def _product(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        y.set(0.0)
        self._operator.add_product(x.array_r.reshape(-1, 3), y.array.reshape(-1, 3))

    def solve(self, equations: Equations, u: FloatArray, tolerance: float, most: int) -> Outcome:
        """As `KrylovMethod.solve`, with the restarts of `stopping`."""
        x, b, ksp, count, error = self._x, self._b, self._ksp, 0, np.nan
        self._begin(equations)
        start = reference = self.rule.energy_norm(u)
        for _ in range(_RUNS):
            allowed = self.rule.allowed(u, tolerance, reference)
            b.array[:] = self.residual(equations, u).ravel()
            ksp.setTolerances(rtol=tolerance, atol=allowed, divtol=_NO_LIMIT, max_it=most)
            reason, iterations = self._solved()
            count += iterations
            if reason > 0 or reason == PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT:
                u = u + x.array_r.reshape(-1, 3)
            if reason < 0:
                break
            history = ksp.getConvergenceHistory()
            first = float(history[0]) if len(history) else np.nan  # |r_0|_M
            moved = float(np.sqrt(max(b.dot(x), 0.0)))  # |u - u_0|_A
            error, least = max(allowed, tolerance * first), 0.5 * max(reference, first)
            if start - moved >= least:
                break
            start = reference = self.rule.energy_norm(u)
            if start >= least:
                break
        return Outcome(u, reason, count, error)
