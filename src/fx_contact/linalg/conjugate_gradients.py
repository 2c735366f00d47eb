"""PCG with a preconditioner of hypre that is kept while the operator changes a little.

A is the operator, M the preconditioner, r the residual, e the error, omega the energy norm (4).  PCG measures the error
by the natural norm,

    |r|_M = (r^T M^-1 r)^(1/2)  ~  (r^T A^-1 r)^(1/2) = (e^T A e)^(1/2).

It goes on from u_0 until

    |r|_M <= max(tol w, tol |r_0|_M, eps |D^(1/2) u_0|),    w = omega(u_0),  D = diag A,  eps = 1e-14 (rounding).

Where the solution has less than half the energy norm that this was relative to, omega(u) < max(w, |r_0|_M) / 2, it goes
on with w = omega(u).  As omega(u) >= omega(u_0) - |u - u_0|_A, omega(u) is seldom needed.
"""

import numpy as np
from petsc4py import PETSc

from fx_contact.linalg.krylov_solver import INSTEAD, RESERVED, KrylovSolver
from fx_contact.linalg.petsc_options import PetscOptions
from fx_contact.linalg.solver_options import PRECONDITIONERS, preconditioner_options
from fx_contact.parallel.errors import SolveError
from fx_contact.parallel.memory import check_memory, shortage

#: Prefixes of PETSc options: the user's, and that of the preconditioner that takes over, which are not the user's.
_PREFIX, _FALLBACK_PREFIX = "fx_", "fx_fallback_"
#: Bytes that a Cholesky factor of n unknowns takes, over n^(4/3): 240 to 270 in blocks, 80 to 170 in plates
#: (`studies.cost.flat --factors`).
_FACTOR_BYTES = 300
#: Iterations without convergence, each since the one before, after which Cholesky's factors take over if their entries
#: take at most so many bytes an unknown.  Those of 4.5 to 5 kB cost the time of 300 to 400 iterations; in bodies that
#: bend PCG takes 400 to more than 2000 (`studies.cost.preconditioners`, `studies.cost.flat --factors`).
LOOKS = ((50, 4.5e3), (150, 6e3))
#: Kinds of preconditioner that factorise the whole matrix.
_FACTORS = (PETSc.PC.Type.CHOLESKY, PETSc.PC.Type.LU)
#: Preconditioners to go on with where PCG fails: the first if there is memory for its factors, else the second.
_FALLBACKS = ("cholesky", "boomeramg-robust")
_ADVICE = (
    "allow more iterations (Solver.max_krylov) or a looser tolerance, use a finer root mesh or cells of better shape, "
    "and see that every body is held"
)
#: Most times that PCG goes on, where the first guess has more energy than the solution.
_ROUNDS = 3
#: Relative error of a product with the operator, by rounding, with some room.
ROUNDING = 1e-14


class ConjugateGradients:
    """PCG on a matrix and a correction, with a preconditioner for the matrix alone, and for held constraints.

    hypre works on the values of the matrix itself, not on a copy.  Were they changed under it, its smoother would no
    longer fit and the preconditioner could become indefinite.  What changes after the set-up is a correction instead.

    Collective on matrix.comm.

    Args:
        matrix: BlockMatrix, symmetric positive definite; it is used up.
        solver: Solver.
        energy_norm: function of a displacement (owned, 3) float64 [m], its energy norm omega (4) [J^(1/2)]; collective.
        objects: PetscObjects, with which what is made here is freed.
        coarse: CoarseLevel, for p-multigrid, or None.

    Attributes:
        matrix: PETSc Mat with its values, in the format that suits the preconditioner; `set_up` must follow a change.
        preconditioner: the present one, a key of `PRECONDITIONERS`, or what PETSc or hypre calls the one that options
            have put in its place; where PCG fails a stronger one takes over.
        iterations: list of int, of each solve.
        energy_error: error of the last solution in the norm of the operator, as asked for [J^(1/2)].

    Raises:
        SceneError: an option that is not the user's, or that ranks do not share.
        SolveError: options that PETSc cannot work with, or a solver that this one cannot be; no memory for factors.
    """

    _CYCLES = 1  # of BoomerAMG below p-multigrid
    #: Instead of `LOOKS` on flat cells, where 7 to 14 iterations do but in bodies that bend (`studies.cost.flat`).
    #: With 30 those stay within three times the iterations on cubes.  In seconds factors pay where cells are flatter
    #: than 1:16 (`studies.cost.preconditioners`).
    _LOOKS_OF_FLAT = ((30, 4.5e3), (170, 6e3))

    def __init__(self, matrix, solver, energy_norm, objects, coarse=None):
        self._coarse = coarse
        self._solver, self._energy_norm, self._comm, self._objects = solver, energy_norm, matrix.comm, objects
        self.iterations, self._failures, self._best, self._looks = [], [], None, []
        self._unknowns = matrix.mat.getSize()[0]
        name = solver.preconditioner or ("boomeramg" if coarse is None else "p-multigrid")
        blocks = coarse is not None and coarse.blocks is not None
        defaults = preconditioner_options(name, self._unknowns, self._CYCLES, blocks)
        self._options = PetscOptions(self._comm, _PREFIX, defaults, solver.options)
        self._options.check_free(RESERVED, INSTEAD)
        if solver.preconditioner is None and "pc_type" not in self._options.of_user:
            self._looks = list(self._LOOKS_OF_FLAT if blocks else LOOKS)
        self._krylov = self._create_krylov()
        self.preconditioner, kind = _name(self._krylov.pc, name), self._krylov.pc.getType()
        if kind in _FACTORS:
            what = f"the preconditioner {kind!r} of {self._unknowns:,} unknowns"
            check_memory(self._comm, what, self._factor_bytes(), "take 'boomeramg', the default, or more hosts")
        if kind == PETSc.PC.Type.MG:
            self._hold(matrix.mat)
        else:
            hypre = kind == PETSc.PC.Type.HYPRE
            self._hold(matrix.in_hypre_format() if hypre else _as_aij(matrix.mat))
            matrix.mat.destroy()
        self._x, self._b = map(objects.add, self.matrix.createVecs())
        self._scale = objects.add(self._x.duplicate())

    def _create_krylov(self, direct=False):
        """The method, perhaps with Cholesky's factors."""
        return KrylovSolver(self._comm, self._options, self._objects)

    def _to_factorise(self):
        """What Cholesky factorises: a copy of the matrix.  Collective."""
        return _as_aij(self.matrix)

    def _hold(self, matrix):
        """Work with a matrix from now on."""
        self.matrix, self._product = self._objects.add(matrix), _Product(matrix)
        self._operator = self._objects.add(PETSc.Mat().createPython(matrix.getSizes(), self._product, matrix.comm))

    def _factor_bytes(self):
        """What this rank's part of Cholesky's factors takes."""
        return _FACTOR_BYTES * self._unknowns ** (4 / 3) / self._comm.size

    def correct(self, correction):
        """From now on solve with the matrix and a correction.  Local.

        Args:
            correction: Springs or None.
        """
        self._product.correction = correction

    def set_up(self):
        """Build the preconditioner for the present values of the matrix.  Collective.

        Raises:
            SceneError: an option of the user that PETSc does not read.
            SolveError: PETSc cannot build it.
        """
        self._krylov.set_up(self._operator, self.matrix, self._coarse)
        self.matrix.getDiagonal(self._scale)
        self._scale.sqrtabs()
        self._best = None

    def stops_paying(self):
        """Whether the last solve needed so many more iterations than the first that a new set-up is cheaper.  Local."""
        return bool(self.iterations) and self._best is not None and self.iterations[-1] > 2 * self._best + 20

    def residual(self, right_hand_side, u):
        """What a displacement leaves of the forces.  Collective.

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
        """Solve to an error relative to the energy norm of the solution.  Collective.

        Args:
            right_hand_side, start: (owned, 3) float64, as for `residual` [N], [m].
            tolerance: of that error [-].
            held: constraint projector P, B P = 0: the start has B u = D, and PCG keeps it but for what stiff springs
                of the operator yield there.  None: no constraint.

        Returns:
            (owned, 3) float64 [m].

        Raises:
            SolveError: divergence, or too many iterations, also with a stronger preconditioner, or with one that
                cannot be set up; an energy that is no number.
        """
        spent, used, u = 0, 0, start  # in all, and with the present preconditioner
        while True:
            left, look = max(self._solver.max_krylov - used, 1), self._looks[0] if self._looks else (np.inf, 0)
            u, reason, count = self._attempt(right_hand_side, u, tolerance, held, min(left, look[0]))
            spent, used, present = spent + count, used + count, self.preconditioner
            if reason > 0:
                break
            if reason == PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT and look[0] < left:
                self._looks.pop(0)
                self._factorise(look[1])
                used = used if self.preconditioner == present else 0
                continue
            self._failures.append(f"with {present} (iterations: {used}, PETSc reason {reason})")
            used = 0
            if not self._fall_back():
                raise SolveError(f"PCG failed {', then '.join(self._failures)}; {_ADVICE}")
        self.iterations.append(spent)
        self._best = spent if self._best is None else self._best
        return u

    def _attempt(self, right_hand_side, u, tolerance, held, most):
        """PCG by the stopping rule above, of some iterations at most.

        Returns:
            The solution, or where PCG has failed what it has gone on from; PETSc's reason for the end, negative for a
            failure; the number of iterations.
        """
        x, b, count = self._x, self._b, 0
        start = reference = self._energy_norm(u)
        for _ in range(_ROUNDS):
            rounding = self._rounding_error(u)
            if not np.isfinite(reference + rounding):
                raise SolveError(
                    f"the energy norm of the displacement that PCG goes on from is {reference} J^(1/2): check the "
                    "units of lengths, moduli and displacements"
                )
            b.array[:] = self.residual(right_hand_side, u).ravel()
            least = max(tolerance * reference, rounding)
            reason, iterations, first = self._krylov.solve(b, x, tolerance, least, most, held)
            count += iterations
            if reason == PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT:
                u = u + x.array.reshape(-1, 3)
            if reason < 0:
                break
            reference, self.energy_error = max(reference, first), max(least, tolerance * first)
            moved = np.sqrt(max(b.dot(x), 0.0))  # |u - u_0|_A
            u = u + x.array.reshape(-1, 3)
            if start - moved >= 0.5 * reference:
                break
            start = self._energy_norm(u)
            if start >= 0.5 * reference:
                break
            reference = start
        return u, reason, count

    def _rounding_error(self, u):
        """eps |D^(1/2) u|: what rounding leaves of a displacement in the norm of the operator, at most [J^(1/2)]."""
        self._x.array[:] = u.ravel()
        self._x.pointwiseMult(self._x, self._scale)
        return ROUNDING * self._x.norm()

    def _fall_back(self):
        """Go on with a stronger preconditioner: whether there is one."""
        direct = PETSc.Sys.hasExternalPackage("mumps") and shortage(self._comm, self._factor_bytes()) is None
        name = _FALLBACKS[0 if direct else 1]
        if self._options.prefix == _FALLBACK_PREFIX or self.preconditioner in (_FALLBACKS[0], name):
            return False
        matrix = self.matrix
        if direct or matrix.type != PETSc.Mat.Type.HYPRE:
            matrix = self._to_factorise() if direct else _as_aij(matrix)
        self._krylov.pc.reset()
        self._take_over(name, *self._solver_of(PRECONDITIONERS[name]), matrix)
        self.set_up()
        return True

    def _factorise(self, most):
        """Go on with Cholesky's factors if their entries take at most so many bytes an unknown.  Collective."""
        most, ranks = most * self._unknowns, self._comm.size
        if self.preconditioner in _FALLBACKS or not PETSc.Sys.hasExternalPackage("mumps"):
            return
        if shortage(self._comm, most / ranks) is not None:
            return
        matrix = self._to_factorise()
        size, memory = analysed(matrix)
        if size > most or shortage(self._comm, memory / ranks) is not None:
            matrix.destroy()
            return
        options, krylov = self._solver_of(PRECONDITIONERS["cholesky"])
        krylov.set_up(matrix, matrix)
        if krylov.pc.getFailedReason():
            krylov.pc.reset()
            matrix.destroy()
            return
        self._krylov.pc.reset()
        self._take_over("cholesky", options, krylov, matrix)
        self.set_up()

    def _solver_of(self, options):
        """PetscOptions and KrylovSolver of a preconditioner that takes over.  Monitors of the user go on too."""
        kept = {option: value for option, value in self._options.of_user.items() if option.startswith("ksp_")}
        direct = options["pc_type"] in _FACTORS
        if direct:
            kept.pop("ksp_type", None)  # MixedSolver has another method then
        self._options, before = PetscOptions(self._comm, _FALLBACK_PREFIX, kept | options, {}), self._options
        krylov, self._options, options = self._create_krylov(direct), before, self._options
        return options, krylov

    def _take_over(self, name, options, krylov, matrix):
        """Let another preconditioner, and perhaps a copy of the matrix, take the place of the present ones."""
        self.preconditioner, self._options, self._krylov = name, options, krylov
        if matrix is not self.matrix:
            before, correction = self.matrix, self._product.correction
            self._operator.destroy()
            self._hold(matrix)
            self.correct(correction)
            before.destroy()


def analysed(matrix):
    """What Cholesky's factors of a matrix take, as MUMPS estimates it before it computes them.

    Collective on matrix.comm.  Ordering and estimate hardly depend on the number of ranks; the memory grows with it.

    Args:
        matrix: PETSc AIJ matrix, symmetric positive definite.

    Returns:
        Bytes of the entries, and of all memory that MUMPS would take: two floats, of all ranks together.
    """
    pc = PETSc.PC().create(matrix.comm)
    pc.setOperators(matrix)
    pc.setType(PETSc.PC.Type.CHOLESKY)
    pc.setFactorSolverType("mumps")
    pc.setFactorSetUpSolverType()
    factor = pc.getFactorMatrix()
    factor.setMumpsIcntl(14, PRECONDITIONERS["cholesky"]["mat_mumps_icntl_14"])
    factor.setMumpsIcntl(23, 1)  # memory [MB], too little to go on after the analysis
    pc.setUp()
    entries, megabytes = factor.getMumpsInfog(20), factor.getMumpsInfog(17)
    pc.destroy()
    return 8.0 * (entries if entries >= 0 else -1e6 * entries), 1e6 * megabytes


def _as_aij(matrix):
    """A copy of a matrix in PETSc's own format, for which MUMPS need not look for pivots."""
    copy = matrix.convert(PETSc.Mat.Type.AIJ, PETSc.Mat())
    copy.setBlockSizes(*matrix.getBlockSizes())  # hypre's rows forget it, blocks are added by it
    copy.setOption(PETSc.Mat.Option.SPD, True)
    return copy


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
