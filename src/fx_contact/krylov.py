"""PCG with a preconditioner of hypre that is kept while the operator changes a little."""

from contextlib import contextmanager
from dataclasses import dataclass, field
from numbers import Real

import numpy as np
from petsc4py import PETSc

from fx_contact.errors import SceneError, SolveError

#: PETSc options of the preconditioners, by name; the first is the fastest of those measured.
PRECONDITIONERS = {
    "boomeramg": {
        "pc_type": "hypre",
        "pc_hypre_type": "boomeramg",
        "pc_hypre_boomeramg_numfunctions": 3,
        "pc_hypre_boomeramg_strong_threshold": 0.5,
        "pc_hypre_boomeramg_coarsen_type": "PMIS",
        "pc_hypre_boomeramg_interp_type": "ext+i",
        "pc_hypre_boomeramg_P_max": 4,
        "pc_hypre_boomeramg_agg_nl": 1,
        "pc_hypre_boomeramg_relax_type_down": "Chebyshev",
        "pc_hypre_boomeramg_relax_type_up": "Chebyshev",
    },
    "ilu": {
        "pc_type": "hypre",
        "pc_hypre_type": "ilu",
        "pc_hypre_ilu_maxiter": 1,
        "pc_hypre_ilu_tol": 0.0,
        "pc_hypre_ilu_tri_solve": True,
    },
}


@dataclass(frozen=True)
class Solver:
    """How the linear systems are solved.

    Attributes:
        preconditioner: a key of `PRECONDITIONERS`.
        tolerance: error of the displacement relative to the displacement, in the norm of the operator with its
            penalty term, as the preconditioner sees it [-].  That norm weighs penetrations with k_N, so the tolerance
            follows the penalty; the default leaves an error below 1e-7 in the contact force.
        loose_tolerance: the same while the active set still changes.
        max_krylov: most iterations of one linear solve.
        max_contact: most updates of the active set.
        options: further PETSc options, without prefix; the command line, under the prefix `fx_`, wins.

    Raises:
        SceneError: an unknown preconditioner, or a tolerance outside (0, 1).
    """

    preconditioner: str = "boomeramg"
    tolerance: float = 2e-10
    loose_tolerance: float = 1e-6
    max_krylov: int = 1000
    max_contact: int = 50
    options: dict = field(default_factory=dict)

    def __post_init__(self):
        if self.preconditioner not in PRECONDITIONERS:
            names = ", ".join(map(repr, PRECONDITIONERS))
            raise SceneError(f"unknown preconditioner {self.preconditioner!r}; there are {names}")
        for name in ("tolerance", "loose_tolerance"):
            value = getattr(self, name)
            if not isinstance(value, Real) or not 0 < value < 1:
                raise SceneError(f"the solver's {name} must lie between 0 and 1, got {value!r}")
        if self.loose_tolerance < self.tolerance:
            raise SceneError(f"loose_tolerance {self.loose_tolerance} is tighter than the tolerance {self.tolerance}")
        for name in ("max_krylov", "max_contact"):
            value = getattr(self, name)
            if not isinstance(value, int) or value < 1:
                raise SceneError(f"the solver's {name} must be a positive whole number, got {value!r}")


class ConjugateGradients:
    """PCG on a matrix and a small correction, with a preconditioner for the matrix alone.

    hypre works on the values of the matrix itself, not on a copy.  Were they changed under it, its smoother would no
    longer fit and the preconditioner could become indefinite.  What changes after the set-up is a correction instead.

    Collective on matrix.mat.comm.

    Args:
        matrix: BlockMatrix, symmetric positive definite; it is used up.
        solver: Solver.

    Attributes:
        matrix: PETSc Mat with its values, in the format that suits the preconditioner; `set_up` must follow a change.
        iterations: list of int, of each solve.
        energy_error: error of the last solution in the norm of the operator, as asked for [J^(1/2)].
    """

    PREFIX = "fx_"

    def __init__(self, matrix, solver):
        self._solver = solver
        self._ksp = ksp = PETSc.KSP().create(matrix.mat.comm)
        ksp.setOptionsPrefix(self.PREFIX)
        ksp.setType(PETSc.KSP.Type.CG)
        ksp.setNormType(PETSc.KSP.NormType.NATURAL)
        ksp.setInitialGuessNonzero(True)
        with _defaults(self.PREFIX, PRECONDITIONERS[solver.preconditioner] | solver.options):
            try:
                ksp.setFromOptions()
            except PETSc.Error as error:
                raise SolveError(
                    f"PETSc does not take the solver's options, under the prefix fx_: {error}"
                ) from error
        hypre = ksp.getPC().getType() == PETSc.PC.Type.HYPRE
        self.matrix = matrix.in_hypre_format() if hypre else matrix.mat.convert(PETSc.Mat.Type.AIJ, PETSc.Mat())
        matrix.mat.destroy()
        self._product = _Product(self.matrix)
        self._operator = PETSc.Mat().createPython(self.matrix.getSizes(), self._product, self.matrix.comm)
        self._x, self._b = self.matrix.createVecs()
        self._best = None
        self.iterations = []

    def correct(self, correction):
        """From now on solve with the matrix and a correction, until `set_up`.

        Args:
            correction: function (x, y) of (owned, 3) float64 that adds its product with x to y; collective.
        """
        self._product.correction = correction

    def set_up(self):
        """Build the preconditioner for the present values of the matrix, which is all of the operator again."""
        self._product.correction = None
        self._ksp.getPC().setReusePreconditioner(False)
        self._ksp.setOperators(self._operator, self.matrix)
        self._ksp.setUp()
        self._ksp.getPC().setReusePreconditioner(True)
        self._best = None

    def stops_paying(self):
        """Whether the last solve needed so many more iterations than the first that a new set-up is cheaper."""
        return bool(self.iterations) and self._best is not None and self.iterations[-1] > 2 * self._best + 20

    def solve(self, right_hand_side, start, tolerance):
        """Solve to a relative error in the norm of the operator.

        Args:
            right_hand_side, start: (owned, 3) float64 [N], [m].
            tolerance: of that error [-].

        Returns:
            (owned, 3) float64 [m].

        Raises:
            SolveError: divergence, NaN, or too many iterations.
        """
        x, b, ksp = self._x, self._b, self._ksp
        x.array[:], b.array[:] = start.ravel(), right_hand_side.ravel()
        # The norm of the solution, from the start where that is a good one, else from the preconditioned load.
        energy = max(_energy(self._operator, x), self._load_norm(b))
        count = 0
        for _ in range(3):
            self.energy_error = tolerance * energy
            self._set_tolerances(rtol=1e-30, atol=self.energy_error, max_it=self._solver.max_krylov)
            ksp.solve(b, x)
            count += ksp.getIterationNumber()
            reason = ksp.getConvergedReason()
            if reason < 0 or not np.isfinite(x.norm()):
                raise SolveError(
                    f"PCG with {self._solver.preconditioner} failed after {count} iterations (PETSc reason {reason}); "
                    "try another preconditioner, a softer penalty, or a looser tolerance"
                )
            reached = _energy(self._operator, x)
            if reached >= 0.5 * energy:
                break
            energy = reached
        self.iterations.append(count)
        self._best = count if self._best is None else self._best
        return x.array.reshape(-1, 3).copy()

    def _set_tolerances(self, **tolerances):
        """Set what the user's command line does not."""
        given = PETSc.Options(self.PREFIX)
        self._ksp.setTolerances(**{k: v for k, v in tolerances.items() if not given.hasName(f"ksp_{k}")})

    def _load_norm(self, b):
        """Energy norm of the preconditioner's answer to the load."""
        z = b.duplicate()
        self._ksp.getPC().apply(b, z)
        return _energy(self._operator, z)

    def destroy(self):
        """Free PETSc's objects."""
        for thing in (self._ksp, self._operator, self._x, self._b, self.matrix):
            thing.destroy()


class _Product:
    """The product of a matrix and a correction, as PETSc calls it."""

    def __init__(self, matrix):
        self._matrix, self.correction = matrix, None

    def mult(self, _, x, y):
        """y = A x."""
        self._matrix.mult(x, y)
        if self.correction is not None:
            self.correction(x.array_r.reshape(-1, 3), y.array.reshape(-1, 3))


def _energy(matrix, x):
    """sqrt(x^T A x)."""
    y = matrix.createVecLeft()
    matrix.mult(x, y)
    return np.sqrt(max(x.dot(y), 0.0))


@contextmanager
def _defaults(prefix, options):
    """PETSc options for as long as they are read, but for those that the user's command line gives."""
    database = PETSc.Options(prefix)
    ours = [name for name in options if not database.hasName(name)]
    for name in ours:
        database[name] = options[name]
    try:
        yield
    finally:
        for name in ours:
            database.delValue(name)
