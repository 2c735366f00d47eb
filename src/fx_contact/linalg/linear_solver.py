"""Linear solver of a stiffness: a Krylov method, its stopping rule, and a ladder of preconditioners."""

from dataclasses import replace
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fx_contact.linalg import ladder
from fx_contact.linalg.krylov import ConjugateGradients, KrylovMethod
from fx_contact.linalg.matrix import BlockMatrix, shift_diagonal
from fx_contact.linalg.mixed_form import FlexibleGmres
from fx_contact.linalg.operator import Equations, MatrixOperator, PressureOperator, Sum
from fx_contact.linalg.p_multigrid import CoarseLevel
from fx_contact.linalg.petsc_objects import PetscObjects, PetscOptions
from fx_contact.linalg.solver_options import PRECONDITIONERS, Solver
from fx_contact.linalg.stopping import EnergyNorm
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import SolveError
from fx_contact.parallel.memory import check_memory

#: Prefixes of PETSc options: of the user, and of a replacement, which the user cannot change.
_PREFIX, _REPLACEMENT_PREFIX = "fx_", "fx_fallback_"
_ADVICE = (
    "allow more iterations (Solver.max_krylov) or a looser tolerance, use a finer root mesh or cells of better shape, "
    "and see that conditions or contact support every body"
)


def suited(matrix: BlockMatrix, solver: Solver, coarse: CoarseLevel | None) -> BlockMatrix:
    """A matrix for a `LinearSolver`: the same, or one in hypre's format in its place.

    Collective on matrix.comm.  Raises SceneError as `LinearSolver`.
    """
    default = PRECONDITIONERS[ladder.first_name(solver, coarse)]["pc_type"]
    kind = _of_user(matrix.comm, solver).get("pc_type", default)
    return replace(matrix, mat=matrix.in_format_of(kind))


class LinearSolver:
    """Solves `Equations` with a stiffness A + V: PCG, or FGMRES if there is a volume term V.

    The entries of the matrix may change; `set_up` then builds the preconditioner.  Cholesky factors that replace
    FGMRES include the volume term, since S is a poor approximation of the Schur complement in thin bodies in bending.

    Collective on matrix.comm.

    Args:
        matrix: A, symmetric positive definite, as of `suited`.
        coarse: level below the matrix, for p-multigrid.
        volume: V; None: 0.

    Attributes:
        preconditioner: the present one, a key of `PRECONDITIONERS`, or PETSc's or hypre's name of the user's own.
        matrix: the given one, in blocks of 3; `set_up` must follow a change.
        iterations: of each solve.
        energy_error: bound of the last solution's error in the energy norm [J^(1/2)].

    Raises:
        SceneError: an option is reserved, is not read by PETSc, or differs between ranks.
        SolveError: PETSc rejects the options, a method or preconditioner is unfit, or there is no memory for factors.
    """

    def __init__(
        self,
        matrix: BlockMatrix,
        solver: Solver,
        energy_norm: EnergyNorm,
        objects: PetscObjects,
        coarse: CoarseLevel | None = None,
        volume: PressureOperator | None = None,
    ) -> None:
        self._comm, self._energy_norm, self._objects = matrix.comm, energy_norm, objects
        self.matrix, self._coarse, self._volume = matrix.mat, coarse, volume
        self._operator = MatrixOperator(matrix.mat, objects)
        self._unknowns, self._most = self.matrix.getSize()[0], solver.max_krylov
        name, of_user = ladder.first_name(solver, coarse), _of_user(self._comm, solver)
        self._singular = False
        self._patience = ladder.patience(solver, self._unknowns, of_user)
        options = ladder.first_options(self._comm, name, self._unknowns, coarse, of_user)
        self._options = PetscOptions(self._comm, _PREFIX, options, solver.options)
        self._method = self._method_of(self._options)
        kind = self._method.preconditioner.pc.getType()
        if kind in ladder.FACTORISATIONS:
            what = f"the preconditioner {kind!r} of {self._unknowns:,} unknowns"
            need = ladder.predicted_bytes(self._unknowns) / self._comm.size
            check_memory(self._comm, what, need, "take 'boomeramg', the default, or more hosts")
        self.preconditioner = self._method.preconditioner.name(name)
        self.iterations: list[int] = []
        self.energy_error = np.nan
        self._failures: list[str] = []
        self._replaced = False
        self._first: int | None = None  # iterations of the first solve since the set-up

    def _method_of(self, options: PetscOptions, whole: bool = False) -> KrylovMethod:
        """PCG without a volume term or for factors of the whole stiffness, else FGMRES."""
        given = self.matrix, self._energy_norm, self._objects
        if self._volume is not None and not whole:
            return FlexibleGmres(options, self._operator, *given, self._volume)
        method = ConjugateGradients(options, Sum([self._operator, self._volume]), *given)
        method.preconditioner.volume, method.preconditioner.singular = self._volume, self._singular
        return method

    def regularise(self) -> None:
        """Make the preconditioner, at the next set-up, one of a singular matrix."""
        if not self._singular and self._coarse is not None:
            shift_diagonal(self._coarse.matrix)
        self._singular = self._method.preconditioner.singular = True

    def set_up(self) -> None:
        """Build the preconditioner for the present values of the matrix."""
        self._method.set_up(self._coarse)
        self._first = None

    @property
    def is_slow(self) -> bool:
        """True if a new set-up is cheaper: the last solve took more than 2 n + 20 iterations, the first n.  Local."""
        return self._first is not None and self.iterations[-1] > 2 * self._first + 20

    def rounding(self, u: FloatArray) -> float:
        """Error of a displacement (owned, 3) [m] by rounding, in the energy norm [J^(1/2)]."""
        return self._method.rule.allowed(u, 0.0, 0.0)

    def residual(self, equations: Equations, u: FloatArray) -> FloatArray:
        """Residual forces (owned, 3) [N] of the last solution u (owned, 3) [m], also for another term."""
        return self._method.residual(equations, u)

    def solve(self, equations: Equations, u: FloatArray, tolerance: float) -> FloatArray:
        """Solution (owned, 3) [m], to an error relative to its energy norm, from a first guess with the constraints.

        Raises:
            SolveError: divergence, or too many iterations, also with the last preconditioner; a preconditioner that
                cannot be set up; an energy that is not finite.
        """
        spent, used = 0, 0  # iterations in all, and with the present preconditioner
        while True:
            most = max((self._patience or self._most) - used, 1)
            outcome = self._method.solve(equations, u, tolerance, most)
            u, spent, used = outcome.displacement, spent + outcome.iterations, used + outcome.iterations
            if outcome.reason > 0:
                break
            early = self._patience is not None and outcome.reason == PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT
            if not early:
                said = f"iterations: {used}, PETSc reason {outcome.reason}"
                self._failures.append(f"with {self.preconditioner} ({said})")
            if self._take_over(early):
                used = 0
            elif not early:
                raise SolveError(f"PCG failed {', then '.join(self._failures)}; {_ADVICE}")
        self.iterations.append(spent)
        self.energy_error, self._first = outcome.error, spent if self._first is None else self._first
        return u

    def _take_over(self, early: bool) -> bool:
        """Change to the next preconditioner, if there is one; early: to factors, if they fit into the memory."""
        self._patience = None
        name = None if self._replaced else ladder.fallback(self._comm, self._unknowns, self.preconditioner)
        if name is None or early and name != "cholesky":
            return False
        kept = {option: value for option, value in self._options.of_user.items() if option.startswith("ksp_")}
        kept.pop("ksp_type", None)  # it may be another method
        options = PetscOptions(self._comm, _REPLACEMENT_PREFIX, kept | PRECONDITIONERS[name], {})
        method = self._method_of(options, whole=name == "cholesky")
        if not early:
            self._method.preconditioner.reset()
        method.set_up(self._coarse)
        if early and method.preconditioner.pc.getFailedReason():
            method.preconditioner.reset()
            return False
        self._method.preconditioner.reset()
        self.preconditioner, self._method, self._replaced, self._first = name, method, True, None
        return True


def _of_user(comm: MPI.Intracomm, solver: Solver) -> dict[str, Any]:
    return PetscOptions(comm, _PREFIX, {}, solver.options).of_user
