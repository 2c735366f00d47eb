"""PCG with a preconditioner of hypre that is kept while the operator changes a little."""

from contextlib import contextmanager

import numpy as np
from petsc4py import PETSc

from fx_contact.linalg.matrix import clear_hypre_errors
from fx_contact.linalg.petsc_options import PetscOptions, any_typed, check_typed
from fx_contact.linalg.solver_options import COVERED, METHODS, NOT_TO_SET, PRECONDITIONERS, preconditioner_options
from fx_contact.parallel.errors import SceneError, SolveError
from fx_contact.parallel.memory import check_memory, shortage
from fx_contact.parallel.mpi import together

#: Bytes that a Cholesky factor of n unknowns in three dimensions takes, over n^(4/3), as measured.
_FACTOR_BYTES = 300
#: Kinds of preconditioner that factorise the whole matrix.
_FACTORS = (PETSc.PC.Type.CHOLESKY, PETSc.PC.Type.LU)
#: Kinds that the solver cannot have, nor solvers inside of it, and why.
_UNFIT = {
    PETSc.PC.Type.NONE: "takes forces for energies, so that the error would depend on the units: take jacobi, which is "
    "as simple",
    PETSc.PC.Type.EISENSTAT: "needs the entries of the operator, and contact is beside its matrix: take sor, of which "
    "it is another form",
    PETSc.PC.Type.MAT: "multiplies by the matrix in place of its inverse, so that the error would depend on the units: "
    "take jacobi, which is as simple",
    PETSc.PC.Type.LMVM: "learns from the steps of a nonlinear solver, of which there are none here: take jacobi, which "
    "is as simple",
}
#: The same of BoomerAMG's smoothers.
_UNFIT_SMOOTHERS = {
    "gaussian-elimination": "would factorise each level as a full matrix, which hypre does not survive: leave it to "
    "the coarsest one"
}
#: Preconditioners to go on with where PCG fails: the first if there is memory for its factors, else the second.
_FALLBACKS = ("cholesky", "boomeramg-robust")
#: What to do where PCG has failed, by PETSc's reason if it tells more than others.
_BETTER = "use a finer root mesh, cells of better shape, or a looser tolerance"
_ADVICE = {
    PETSc.KSP.ConvergedReason.DIVERGED_PCSETUP_FAILED: "its preconditioner cannot be set up, for want of memory or "
    "because the matrix is singular: take 'boomeramg', the default, and look at what holds each body",
    PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT: f"allow more with Solver.max_krylov, or {_BETTER}",
}
#: A residual that grows is no failure: that of a good first guess is small against those of the first iterations.
_NO_LIMIT = 1e30
#: How long a rank on which PETSc has failed waits for others, which may never come back from PETSc [s].
_PATIENCE = 10.0
#: Relative error of a product with the operator, by rounding, with some room.
ROUNDING = 1e-14


class ConjugateGradients:
    """PCG on a matrix and a correction, with a preconditioner for the matrix alone, and for pairs that are held.

    hypre works on the values of the matrix itself, not on a copy.  Were they changed under it, its smoother would no
    longer fit and the preconditioner could become indefinite.  What changes after the set-up is a correction instead.

    Collective on matrix.mat.comm.

    Args:
        matrix: BlockMatrix, symmetric positive definite; it is used up.
        solver: Solver.
        energy_norm: function of a displacement (owned, 3) float64 [m], its energy norm omega (4) [J^(1/2)]; collective.
        objects: PetscObjects, with which what is made here is freed.

    Attributes:
        matrix: PETSc Mat with its values, in the format that suits the preconditioner; `set_up` must follow a change.
        preconditioner: the present one, a key of `PRECONDITIONERS`, or what PETSc or hypre calls the one that options
            have put in its place; where PCG fails a stronger one takes over.
        iterations: list of int, of each solve.
        energy_error: error of the last solution in the norm of the operator, as asked for [J^(1/2)].

    Raises:
        SceneError: an option that is misspelt or not the user's, or that ranks do not share.
        SolveError: options that PETSc cannot work with, or a solver that this one cannot be; no memory for factors.
    """

    PREFIX, FALLBACK_PREFIX = "fx_", "fx_fallback_"

    def __init__(self, matrix, solver, energy_norm, objects):
        self._solver, self._energy_norm, self._comm, self._objects = solver, energy_norm, matrix.comm, objects
        self.iterations, self._failures, self._unknowns = [], [], matrix.mat.getSize()[0]
        check_typed(self._comm, self.PREFIX)
        self._check_fallback_options(matrix.mat.comm)
        self._create_ksp(matrix.mat.comm, solver.preconditioner, self.PREFIX, solver.options)
        if self._ksp.getPC().getType() in _FACTORS:
            self._check_factors()
        hypre = self._ksp.getPC().getType() == PETSc.PC.Type.HYPRE
        self._hold(matrix.in_hypre_format() if hypre else matrix.mat.convert(PETSc.Mat.Type.AIJ, PETSc.Mat()))
        matrix.mat.destroy()
        self._x, self._b = map(objects.add, self.matrix.createVecs())
        self._scale = objects.add(self._x.duplicate())

    def _create_ksp(self, comm, preconditioner, prefix, given):
        """PCG with options that the user may replace, under a prefix."""
        self._prefix = prefix
        others = (self.FALLBACK_PREFIX,) if prefix == self.PREFIX else ()
        options = preconditioner_options(preconditioner, self._unknowns)
        self._options = PetscOptions(self._comm, prefix, options, given, others, COVERED)
        self._options.check_free(NOT_TO_SET)
        self._options.check_kinds(("pc_type", "pc_composite_pcs"), _UNFIT)
        self._options.check_kinds(("relax_type_all", "relax_type_down", "relax_type_up"), _UNFIT_SMOOTHERS)
        self._ksp = ksp = self._objects.add(PETSc.KSP().create(comm))
        ksp.setOptionsPrefix(prefix)
        ksp.setType(PETSc.KSP.Type.CG)
        ksp.setNormType(PETSc.KSP.NormType.NATURAL)
        ksp.setConvergenceHistory(1, reset=True)
        with self._options.there(), self._named_errors():
            ksp.setFromOptions()
        if ksp.getType() not in METHODS:
            raise SolveError(
                f"the Krylov method must be one of {', '.join(METHODS)}, which work in the norm of the energy, "
                f"got -{prefix}ksp_type {ksp.getType()}"
            )
        with self._named_errors():
            norm = ksp.getNormType()
        if norm != PETSc.KSP.NormType.NATURAL:
            raise SolveError(
                f"the Krylov method works in the norm of the energy: leave out -{prefix}ksp_norm_type, or set it to "
                "natural"
            )
        self._pc, self._holding, self._rest = self._objects.add(ksp.getPC()), None, None
        self.preconditioner = _name(self._pc, preconditioner)

    def _check_fallback_options(self, comm):
        """See that options for the fallback are the user's to give, and not misspelt, before it is needed.

        The memory will decide which one it is: what either of them reads is right.  Options that only its set-up reads
        are known no sooner.
        """
        if any_typed(self.FALLBACK_PREFIX):
            for name in _FALLBACKS:
                self._create_ksp(comm, name, self.FALLBACK_PREFIX, {})
                self._destroy_ksp()
            self._options.check_read(set_up=False)

    def _check_factors(self):
        """See that there is memory for the factors that the user has chosen."""
        what = f"the preconditioner {self._ksp.getPC().getType()!r} of {self._unknowns:,} unknowns"
        check_memory(self._comm, what, self._factor_bytes(), "take 'boomeramg', the default, or more hosts")

    def _factor_bytes(self):
        """What this rank's part of Cholesky's factors takes."""
        return _FACTOR_BYTES * self._unknowns ** (4 / 3) / self._comm.size

    @contextmanager
    def _named_errors(self):
        """PETSc's errors as SolveError on all ranks; an error of Python that PETSc has met in our callbacks as it is.

        Collective.  PETSc may fail on one rank alone: rank 0 opens the files of monitors and views.  Objects of PETSc
        are not the same on all ranks then, so that they cannot be freed.
        """
        try:
            with together(self._comm, _PATIENCE):
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
                        f"PETSc cannot work with the solver's options, under the prefix {self._prefix}, as they are: "
                        f"{cause}"
                    ) from error
        except BaseException:
            self._objects.leave()
            raise

    def _hold(self, matrix):
        """Work with a matrix from now on."""
        self.matrix, self._product = self._objects.add(matrix), _Product(matrix)
        self._operator = self._objects.add(PETSc.Mat().createPython(matrix.getSizes(), self._product, matrix.comm))

    def correct(self, correction):
        """From now on solve with the matrix and a correction.

        Args:
            correction: Springs or None.
        """
        self._product.correction = correction

    def set_up(self):
        """Build the preconditioner for the present values of the matrix."""
        self._pc.setReusePreconditioner(False)
        self._ksp.setPC(self._pc)
        self._ksp.setOperators(self._operator, self.matrix)
        with self._options.there(), self._named_errors():
            self._ksp.setUp()
        second = self._prefix == self.FALLBACK_PREFIX and self.preconditioner == _FALLBACKS[1]
        self._options.check_read(set_up=not second)  # what the first fallback would have read is no mistake
        self._pc.setReusePreconditioner(True)
        self.matrix.getDiagonal(self._scale)
        self._scale.sqrtabs()
        self._best = None

    def stops_paying(self):
        """Whether the last solve needed so many more iterations than the first that a new set-up is cheaper."""
        return bool(self.iterations) and self._best is not None and self.iterations[-1] > 2 * self._best + 20

    def residual(self, right_hand_side, u):
        """What a displacement leaves of the forces.

        Args:
            right_hand_side: (owned, 3) float64, that of the matrix alone: the correction has its own [N].
            u: (owned, 3) float64 [m].

        Returns:
            (owned, 3) float64 [N].
        """
        self._x.array[:] = u.ravel()
        self.matrix.mult(self._x, self._b)
        forces = self._b.array.reshape(-1, 3)
        if self._product.correction is not None:
            self._product.correction.add_force(u, forces)
        return right_hand_side - forces

    def solve(self, right_hand_side, start, tolerance, held=None):
        """Solve to an error relative to the energy norm of the solution.

        Args:
            right_hand_side, start: (owned, 3) float64, as for `residual` [N], [m].
            tolerance: of that error [-].
            held: Projection onto what leaves some pairs as they are, which the operator's stiff springs, or rigid ones
                that it lacks, hold in the position that they have at the start; None: there are none.

        Returns:
            (owned, 3) float64 [m].

        Raises:
            SolveError: divergence, or too many iterations, also with a stronger preconditioner, or with one that
                cannot be set up; an energy that is no number.
            SceneError: a stronger one takes over, and does not read an option that is for it.
        """
        spent = 0
        while True:
            self._leave(held)
            u, reason, count = self._attempt(right_hand_side, start, tolerance)
            if reason > 0:
                break
            spent += count
            plural = "" if count == 1 else "s"
            self._failures.append(
                f"with {self.preconditioner} after {count} iteration{plural} (PETSc reason {reason})"
            )
            failed = f"PCG failed {', then '.join(self._failures)}"
            try:
                goes_on = self._fall_back()
            except (SceneError, SolveError) as error:
                raise type(error)(f"{failed}, and what was to take over cannot be used: {error}") from error
            if not goes_on:
                raise SolveError(f"{failed}; {_ADVICE.get(reason, _BETTER)}")
        self.iterations.append(spent + count)
        self._best = self.iterations[-1] if self._best is None else self._best
        return u

    def _leave(self, held):
        """Let the preconditioner leave held pairs to their springs, or None."""
        if held is not None and self._holding is None:
            self._rest = self._objects.add(self.matrix.createVecRight())
            holding = PETSc.PC().createPython(_Holding(self._pc, self._rest), self._ksp.comm)
            self._holding = self._objects.add(holding)
            self._holding.setOperators(self._operator, self.matrix)
        if self._holding is not None:
            self._holding.getPythonContext().held = held
        self._ksp.setPC(self._pc if held is None else self._holding)

    def _attempt(self, right_hand_side, u, tolerance):
        """Solution or what is there of it, PETSc's reason for the end, negative for a failure, and the iterations."""
        x, b, ksp, count = self._x, self._b, self._ksp, 0
        start = energy = self._energy_norm(u)
        for _ in range(3):
            rounding = self._rounding_error(u)
            if not np.isfinite(energy + rounding):
                raise SolveError(
                    f"the energy norm of the displacement that PCG goes on from is {energy} J^(1/2): check the units "
                    "of lengths, moduli and displacements"
                )
            b.array[:] = self.residual(right_hand_side, u).ravel()
            least = max(tolerance * energy, rounding)
            # Of a start without energy, the residual tells that of the solution: the tolerance is relative to both.
            ksp.setTolerances(rtol=tolerance, atol=least, divtol=_NO_LIMIT, max_it=self._solver.max_krylov)
            with self._named_errors():
                ksp.solve(b, x)
            count += ksp.getIterationNumber()
            reason = ksp.getConvergedReason()
            if reason < 0 or not np.isfinite(x.norm()):
                reason = min(reason, PETSc.KSP.ConvergedReason.DIVERGED_NANORINF if reason > 0 else reason)
                return u, reason, count
            first = ksp.getConvergenceHistory()[0]
            energy, self.energy_error = max(energy, first), max(least, tolerance * first)
            moved = np.sqrt(max(b.dot(x), 0.0))  # energy norm of the step
            u = u + x.array.reshape(-1, 3)
            if start - moved >= 0.5 * energy:
                break
            start = self._energy_norm(u)
            if start >= 0.5 * energy:
                break
            energy = start
        return u, reason, count

    def _fall_back(self):
        """Go on with a stronger preconditioner, if there is one; what options have put in its place is the last."""
        direct = PETSc.Sys.hasExternalPackage("mumps") and shortage(self._comm, self._factor_bytes()) is None
        name = _FALLBACKS[0 if direct else 1]
        if self._prefix == self.FALLBACK_PREFIX or self.preconditioner in (_FALLBACKS[0], name):
            return False
        comm, before, product = self._ksp.comm, self.matrix, self._product
        self._destroy_ksp()
        self._create_ksp(comm, name, self.FALLBACK_PREFIX, {})
        kind = PETSc.Mat.Type.AIJ if direct else PETSc.Mat.Type.HYPRE
        if before.type != kind and not (direct and before.type.endswith("aij")):
            self._operator.destroy()
            self._hold(before.convert(kind, PETSc.Mat()))
            self.matrix.setBlockSizes(*before.getBlockSizes())  # hypre's rows forget it, blocks are added by it
            self._product.correction = product.correction
            before.destroy()
        self.set_up()
        return True

    def _rounding_error(self, u):
        """What rounding leaves of a displacement in the norm of the operator, at most [J^(1/2)]."""
        self._x.array[:] = u.ravel()
        self._x.pointwiseMult(self._x, self._scale)
        return ROUNDING * self._x.norm()

    def _destroy_ksp(self):
        for thing in (self._ksp, self._holding, self._rest, self._pc):
            if thing is not None:
                thing.destroy()


def _name(pc, asked):
    """The key of `PRECONDITIONERS` that was asked for if PETSc has taken it, else the type that it took.  Local."""
    options, kind = PRECONDITIONERS[asked], pc.getType()
    if kind == PETSc.PC.Type.HYPRE:
        kind = pc.getHYPREType()
    return asked if kind == options.get("pc_hypre_type", options["pc_type"]) else kind


class _Product:
    """The product of a matrix and a correction, as PETSc calls it."""

    def __init__(self, matrix):
        self._matrix, self.correction = matrix, None

    def mult(self, _, x, y):
        """y = A x."""
        self._matrix.mult(x, y)
        if self.correction is not None:
            self.correction.add_product(x.array_r.reshape(-1, 3), y.array.reshape(-1, 3))


class _Holding:
    """P M^-1 P^T, with P the projection onto what leaves held pairs as they are, and the springs' own inverse.

    The stiffer the springs, the less have the two parts to do with each other; rigid ones do not move.
    """

    def __init__(self, inner, rest):
        self._inner, self._rest, self.held = inner, rest, None

    def apply(self, _, x, y):
        """y = (P M^-1 P^T + springs) x."""
        x.copy(self._rest)
        forces = self.held.apply_transpose(self._rest.array.reshape(-1, 3))
        self._inner.apply(self._rest, y)
        u = y.array.reshape(-1, 3)
        self.held.apply(u)
        self.held.add_yielding(forces, u)

    def view(self, _, viewer):
        """What `-fx_ksp_view` shows."""
        self._inner.view(viewer)
