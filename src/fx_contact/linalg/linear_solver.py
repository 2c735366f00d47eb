"""Linear solver of a stiffness matrix: a Krylov method, its stopping rule, and a ladder of preconditioners."""

from dataclasses import replace
from typing import Any

import numpy as np
from petsc4py import PETSc

from fx_contact.linalg import ladder
from fx_contact.linalg.krylov import ConjugateGradients, KrylovMethod, KrylovSolver
from fx_contact.linalg.ladder import FALLBACKS, Factors, Ladder
from fx_contact.linalg.matrix import BlockMatrix, as_aij, is_symmetric
from fx_contact.linalg.mixed_form import FlexibleGmres, PressureOperator
from fx_contact.linalg.operator import Equations, MatrixOperator
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


class LinearSolver:
    """Solves `Equations` with a stiffness A: PCG, or FGMRES if a volume term stands beside the matrix.

    The entries of the matrix may change; `set_up` then builds the preconditioner.  Cholesky factors that replace
    FGMRES include the volume term, since S is a poor approximation of the Schur complement in thin bodies in bending.

    Collective on matrix.comm.

    Args:
        matrix: A without the volume term, symmetric positive definite; owned by the solver from now on.
        coarse: level below the matrix, for p-multigrid.

    Attributes:
        preconditioner: the present one, a key of `PRECONDITIONERS`, or PETSc's or hypre's name of the user's own.
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
        self._coarse, self._volume = coarse, volume
        unknowns = matrix.mat.getSize()[0]
        self._ladder = Ladder(solver, unknowns, matrix.entries, coarse, volume is not None)
        self._factors: Factors | None = None  # not analysed
        # Bytes of an AIJ copy for the analysis: 12 an entry, and as many in PETSc's conversion from hypre's format.
        self._copy = 0.0 if matrix.symmetric else 24.0 * matrix.entries
        of_user = PetscOptions(self._comm, _PREFIX, {}, solver.options).of_user
        if "pc_type" in of_user:
            self._ladder.check_at(None)
        options = self._ladder.options(self._factorises_coarse(of_user))
        self._options = PetscOptions(self._comm, _PREFIX, options, solver.options)
        krylov = _method(volume).create(self._comm, self._options, objects)
        kind = krylov.preconditioner.pc.getType()
        if kind in ladder.FACTORISATIONS:
            what = f"the preconditioner {kind!r} of {unknowns:,} unknowns"
            need = ladder.predicted_bytes(unknowns) / self._comm.size
            check_memory(self._comm, what, need, "take 'boomeramg', the default, or more hosts")
        self._method = self._method_of(krylov, matrix.in_format_of(kind), volume)
        self.preconditioner = krylov.preconditioner.name(self._ladder.name)
        self.iterations: list[int] = []
        self.energy_error = np.nan
        self._failures: list[str] = []
        self._replaced = False
        self._first: int | None = None  # iterations of the first solve since the set-up
        self._before = 0  # and of all solves before the present one

    def _factorises_coarse(self, of_user: dict[str, Any]) -> bool:
        """True if factors of the coarse level are cheap and the options of the user leave the choice."""
        chosen = any(name == "pc_type" or name.startswith("mg_coarse") for name in of_user)
        if self._ladder.name != "p-multigrid" or self._coarse is None or chosen:
            return False
        matrix = self._coarse.matrix
        if not ladder.can_be_made(self._comm, ladder.predicted_bytes(matrix.getSize()[0])):
            return False
        return self._ladder.iterations(ladder.analysed(matrix).flops) <= ladder.COARSE

    def _method_of(self, krylov: KrylovSolver, mat: PETSc.Mat, volume: PressureOperator | None) -> KrylovMethod:
        stiffness = MatrixOperator(self._objects.add(mat), self._objects)
        if volume is None:
            return ConjugateGradients(krylov, stiffness, mat, self._energy_norm, self._objects)
        return FlexibleGmres(krylov, stiffness, mat, volume, self._energy_norm, self._objects)

    @property
    def matrix(self) -> PETSc.Mat:
        """The matrix of the preconditioner, in a format that suits it; `set_up` must follow a change."""
        return self._method.matrix

    def set_up(self) -> None:
        """Build the preconditioner for the present values of the matrix."""
        self._method.set_up(self._coarse)
        self._first, self._before = None, 0

    @property
    def is_slow(self) -> bool:
        """True if a new set-up is cheaper: the last solve took more than 2 n + 20 iterations, the first n.  Local."""
        return self._first is not None and self.iterations[-1] > 2 * self._first + 20

    def residual(self, equations: Equations, u: FloatArray) -> FloatArray:
        """Residual forces (owned, 3) [N] of the last solution u (owned, 3) [m], also for another term."""
        return self._method.residual(self._given(equations, u), u)

    def solve(self, equations: Equations, u: FloatArray, tolerance: float) -> FloatArray:
        """Solution (owned, 3) [m], to an error relative to its energy norm, from a first guess with the constraints.

        Raises:
            SolveError: divergence, or too many iterations, also with the last preconditioner; a preconditioner that
                cannot be set up; an energy that is not finite.
        """
        spent, used = 0, 0  # iterations in all, and with the present preconditioner
        while True:
            outcome = self._method.solve(
                self._given(equations, u), u, tolerance, self._ladder.limit(used, self._before)
            )
            u, spent, used = outcome.displacement, spent + outcome.iterations, used + outcome.iterations
            if outcome.reason > 0:
                break
            slow = outcome.reason == PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT
            if slow and self._ladder.due(self._before + used):
                used = 0 if self._factorise(self._before + used) else used
                continue
            self._failures.append(f"with {self.preconditioner} (iterations: {used}, PETSc reason {outcome.reason})")
            used = 0
            if not self._fall_back():
                raise SolveError(f"PCG failed {', then '.join(self._failures)}; {_ADVICE}")
        self.iterations.append(spent)
        self._before += used
        self.energy_error, self._first = outcome.error, spent if self._first is None else self._first
        return u

    def _given(self, equations: Equations, u: FloatArray) -> Equations:
        """For factors with the volume term, equations less its forces of prescribed displacements."""
        if self._volume is None or isinstance(self._method, FlexibleGmres):
            return equations
        return replace(equations, load=equations.load - self._volume.prescribed_forces(u))

    def _with_volume_term(self, mat: PETSc.Mat) -> PETSc.Mat:
        """The matrix after adding the volume term, which changes no sparsity."""
        if self._volume is not None:
            self._volume.add_to(mat)
        return mat

    def _factorise(self, spent: int) -> bool:
        """Change to Cholesky factors if they cost at most so many iterations; False: later, or they do not fit."""
        self._ladder.check_at(None)
        if self._replaced or self.preconditioner in FALLBACKS or not ladder.can_be_made(self._comm, self._copy):
            return False
        if self._factors is None:
            self._factors = self._analysed()
        price = self._ladder.iterations(self._factors.flops)
        if price > spent:
            self._ladder.check_at(price)
        elif ladder.can_be_made(self._comm, self._factors.memory):
            mat = self._with_volume_term(as_aij(self.matrix))
            method = self._replacement("cholesky", mat)
            if not method.preconditioner.pc.getFailedReason():
                self._method.preconditioner.pc.reset()
                self._replace("cholesky", method)
                return True
            method.preconditioner.pc.reset()
            mat.destroy()
        return False

    def _analysed(self) -> Factors:
        """The costs of factors: without a copy of a symmetric matrix, and without the volume term."""
        mat = self.matrix if is_symmetric(self.matrix) else as_aij(self.matrix)
        mat.setOption(PETSc.Mat.Option.SPD, True)
        factors = ladder.analysed(mat)
        if mat is not self.matrix:
            mat.destroy()
        return factors

    def _fall_back(self) -> bool:
        name = None if self._replaced else self._ladder.fallback(self._comm, self.preconditioner)
        if name is None:
            return False
        if name == "cholesky":
            mat = self._with_volume_term(as_aij(self.matrix))
        else:
            mat = self.matrix if self.matrix.type == PETSc.Mat.Type.HYPRE else as_aij(self.matrix)
        self._method.preconditioner.pc.reset()
        self._replace(name, self._replacement(name, mat))
        return True

    def _replacement(self, name: str, mat: PETSc.Mat) -> KrylovMethod:
        """A method with another preconditioner, set up, with the monitors of the user."""
        kept = {option: value for option, value in self._options.of_user.items() if option.startswith("ksp_")}
        volume = None if name == "cholesky" else self._volume
        if volume is not self._volume:
            kept.pop("ksp_type", None)  # another method
        options = PetscOptions(self._comm, _REPLACEMENT_PREFIX, kept | PRECONDITIONERS[name], {})
        krylov = _method(volume).create(self._comm, options, self._objects)
        method = self._method_of(krylov, mat, volume)
        method.set_up(self._coarse)
        return method

    def _replace(self, name: str, method: KrylovMethod) -> None:
        before = self.matrix
        self.preconditioner, self._method, self._replaced, self._first = name, method, True, None
        self._ladder.check_at(None)
        if method.matrix is not before:
            before.destroy()


def _method(volume: PressureOperator | None) -> type[KrylovMethod]:
    return ConjugateGradients if volume is None else FlexibleGmres
