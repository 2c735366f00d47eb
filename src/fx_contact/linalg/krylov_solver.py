"""PETSc's conjugate gradients in the natural norm: set up from options, with PETSc's errors raised on all ranks."""

from contextlib import contextmanager

import numpy as np
from petsc4py import PETSc

from fx_contact.linalg.matrix import clear_hypre_errors
from fx_contact.linalg.p_multigrid import solved_here, within_blocks
from fx_contact.parallel.errors import SolveError
from fx_contact.parallel.mpi import together

#: PETSc options that would undo what the solver states of its error, and what to set instead.
RESERVED = set(
    "ksp_rtol ksp_atol ksp_divtol ksp_max_it ksp_convergence_test ksp_converged_maxits ksp_error_if_not_converged "
    "ksp_initial_guess_nonzero ksp_norm_type ksp_pc_side".split()
)
INSTEAD = (
    "set Solver.tolerance, Solver.loose_tolerance or Solver.max_krylov, which hold for the error in the energy norm"
)
#: Preconditioners that are no inverse of the matrix, so that the natural norm is not that of the energy, and one that
#: needs the entries of the operator, where contact is beside its matrix.
_UNFIT = (PETSc.PC.Type.NONE, PETSc.PC.Type.MAT, PETSc.PC.Type.LMVM, PETSc.PC.Type.EISENSTAT)
#: The residual may grow: that of a good first guess is small against those of the first iterations.
_NO_LIMIT = 1e30
#: How long a rank on which PETSc has failed waits for the others, which may never come back from PETSc [s].
_TIMEOUT = 10.0


class KrylovSolver:
    """A KSP of PETSc with its preconditioner.

    Collective on comm.

    Args:
        comm: MPI communicator of the run.
        options: PetscOptions.
        objects: PetscObjects, with which what is made here is freed.

    Attributes:
        pc: PETSc PC, the preconditioner of the matrix.

    Raises:
        SolveError: options that PETSc cannot work with, or a method or preconditioner whose error is not that in the
            energy norm.
    """

    #: For `ksp_type`, the first by default: conjugate gradients that PETSc has in the natural norm.
    METHODS = ("cg", "fcg", "groppcg", "pipecg", "pipefcg")
    _NORM = PETSc.KSP.NormType.NATURAL
    _smooths_blocks = False  # whether the smoother knows the blocks, which PETSc can be told once

    def __init__(self, comm, options, objects):
        self._comm, self._options, self._objects, self._holding = comm, options, objects, None
        self._ksp = ksp = objects.add(PETSc.KSP().create(comm))
        ksp.setOptionsPrefix(options.prefix)
        ksp.setType(self.METHODS[0])
        ksp.setNormType(self._NORM)
        ksp.setConvergenceHistory(1, reset=True)
        with options.there(), self._errors_on_all_ranks():
            ksp.setFromOptions()
        self.pc = objects.add(ksp.getPC())
        if ksp.getType() not in self.METHODS or self.pc.getType() in _UNFIT:
            raise SolveError(
                f"-{options.prefix}ksp_type {ksp.getType()} -{options.prefix}pc_type {self.pc.getType()} cannot be "
                f"used: the method must be one of {', '.join(self.METHODS)}, which stop by the energy norm, and the "
                f"preconditioner an inverse of the matrix alone, not {', '.join(_UNFIT)}: jacobi is as simple"
            )

    @contextmanager
    def _errors_on_all_ranks(self):
        """PETSc's errors become SolveError; those of Python that PETSc has met in our callbacks are raised as they are.

        Collective.  PETSc may fail on one rank alone: rank 0 opens the files of monitors and views.  Then its objects
        are not the same on all ranks, and cannot be freed.
        """
        try:
            with together(self._comm, _TIMEOUT):
                try:
                    yield
                except PETSc.Error as error:
                    clear_hypre_errors()
                    cause = error
                    while isinstance(cause, PETSc.Error) and cause.__cause__ is not None:
                        cause = cause.__cause__
                    if not isinstance(cause, PETSc.Error):
                        raise cause from None
                    raise SolveError(
                        f"PETSc cannot work with the solver's options, under the prefix {self._options.prefix}, as "
                        f"they are: {cause}"
                    ) from error
        except BaseException:
            self._objects.leak()
            raise

    def set_up(self, operator, matrix, coarse=None):
        """Build the preconditioner for the present values of the matrix, and keep it.

        Collective on comm.

        Args:
            operator: PETSc Mat to solve with.
            matrix: PETSc Mat to build the preconditioner from.
            coarse: CoarseLevel below the matrix, for a multigrid of two levels.

        Raises:
            SceneError: an option of the user that PETSc does not read.
            SolveError: PETSc cannot build it.
        """
        self.pc.setReusePreconditioner(False)
        self.pc.setOperators(operator, matrix)
        if self.pc.getType() == PETSc.PC.Type.MG and coarse is not None:
            self.pc.setMGInterpolation(1, coarse.interpolation)
            self.pc.getMGCoarseSolve().setOperators(coarse.matrix)
            if coarse.blocks is not None:
                self._smooth_blocks(matrix, coarse.blocks)
        with self._options.there(), self._errors_on_all_ranks():
            self._set_up(operator, matrix)
        self._options.check_read()
        self.pc.setReusePreconditioner(True)

    def _smooth_blocks(self, matrix, blocks):
        """Let the smoother of multigrid solve for blocks of nodes at once, whatever ranks own them."""
        smoother, inside = self.pc.getMGSmoother(1), within_blocks(matrix, blocks)
        smoother.setOperators(matrix, inside)
        inside.destroy()  # the smoother has a reference
        if self._smooths_blocks:
            return
        self._smooths_blocks = True
        with self._options.there(), self._errors_on_all_ranks():
            smoother.setFromOptions()
        here = solved_here(matrix, blocks)
        smoother.getPC().setASMLocalSubdomains(1, [here])
        here.destroy()

    def _set_up(self, operator, matrix):
        self._ksp.setPC(self.pc)
        self._ksp.setOperators(operator, matrix)
        self._ksp.setUp()

    def solve(self, b, x, rtol, atol, max_it, held=None):
        """Solve from zero until the natural norm of the residual is below atol, or rtol times its first one.

        Collective on comm.

        Args:
            b, x: PETSc Vec, right-hand side and solution.
            rtol, atol: tolerances [-], [J^(1/2)].
            max_it: most iterations.
            held: constraint projector P, B P = 0, or None.

        Returns:
            PETSc's reason for the end, negative for a failure; the number of iterations; the first norm [J^(1/2)].
        """
        self._ksp.setPC(self.pc if held is None else self._holding_pc(held))
        self._ksp.setTolerances(rtol=rtol, atol=atol, divtol=_NO_LIMIT, max_it=max_it)
        with self._errors_on_all_ranks():
            self._ksp.solve(b, x)
        reason, history = self._ksp.getConvergedReason(), self._ksp.getConvergenceHistory()
        if reason > 0 and not np.isfinite(x.norm()):
            reason = PETSc.KSP.ConvergedReason.DIVERGED_NANORINF
        return reason, self._ksp.getIterationNumber(), history[0] if len(history) else np.nan

    def _holding_pc(self, held):
        """The preconditioner with the projector of held constraints."""
        if self._holding is None:
            operator, matrix = self.pc.getOperators()
            context = _Holding(self.pc, self._objects.add(matrix.createVecRight()))
            self._holding = self._objects.add(PETSc.PC().createPython(context, self._comm))
            self._holding.setOperators(operator, matrix)
        self._holding.getPythonContext().held = held
        return self._holding


class _Holding:
    """P M^-1 P^T + S: P projects on B u = 0, B the rows of held constraints; S is the inverse of their springs.

    The stiffer the springs, the weaker the coupling of the two parts; S = 0 for rigid ones.
    """

    def __init__(self, inner, rest):
        self._inner, self._rest, self.held = inner, rest, None

    def apply(self, _, x, y):
        """y = (P M^-1 P^T + S) x."""
        x.copy(self._rest)
        forces = self.held.apply_transpose(self._rest.array.reshape(-1, 3))
        self._inner.apply(self._rest, y)
        u = y.array.reshape(-1, 3)
        self.held.apply(u)
        self.held.add_yielding(forces, u)

    def view(self, _, viewer):
        """What `-fx_ksp_view` shows."""
        self._inner.view(viewer)
