"""The linear solver with its preconditioner, and the contact loop over active sets."""

from contextlib import contextmanager
from dataclasses import dataclass, field
from numbers import Real

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fx_contact.contact import PenaltyTerm, loose_bodies
from fx_contact.errors import SceneError, SolveError

#: PETSc options of the preconditioners, by name; the first is the fastest of those measured.
PRECONDITIONERS = {
    "boomeramg": {
        "pc_type": "hypre",
        "pc_hypre_type": "boomeramg",
        "pc_hypre_boomeramg_numfunctions": 3,
        "pc_hypre_boomeramg_strong_threshold": 0.25,
        "pc_hypre_boomeramg_coarsen_type": "HMIS",
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
    loose_tolerance: float = 1e-4
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
    """PCG on one matrix whose values may change while the preconditioner is kept.

    Collective on matrix.comm.

    Args:
        matrix: PETSc Mat, symmetric positive definite.
        solver: Solver.

    Attributes:
        iterations: list of int, of each solve.
        energy_error: error of the last solution in the norm of the operator, as asked for [J^(1/2)].
    """

    PREFIX = "fx_"

    def __init__(self, matrix, solver):
        self._matrix, self._solver = matrix, solver
        self._ksp = ksp = PETSc.KSP().create(matrix.comm)
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
        self._x, self._b = matrix.createVecs()
        self._best = None
        self.iterations = []

    def set_up(self):
        """Build the preconditioner for the present values of the matrix."""
        self._ksp.getPC().setReusePreconditioner(False)
        self._ksp.setOperators(self._matrix)
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
        energy = max(_energy(self._matrix, x), self._load_norm(b))
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
            reached = _energy(self._matrix, x)
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
        return _energy(self._matrix, z)

    def destroy(self):
        """Free PETSc's objects."""
        for thing in (self._ksp, self._x, self._b):
            thing.destroy()


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


@dataclass(frozen=True, eq=False)
class ContactSolution:
    """The end of the contact loop.

    Attributes:
        displacement: (owned, 3) float64, conforming [m].
        active: (n,) bool, status of this rank's node pairs.
        force: (n,) float64, contact force of each pair, compression positive [N].
        penetration: (n,) float64, positive where the bodies overlap [m].
        contact_iterations: number of active sets tried.
        krylov_iterations: of each linear solve.
        energy_error: how far the linear solver may be from the solution in the operator's norm [J^(1/2)].
    """

    displacement: np.ndarray
    active: np.ndarray
    force: np.ndarray
    penetration: np.ndarray
    contact_iterations: int
    krylov_iterations: list[int]
    energy_error: float


#: Changed pairs that the preconditioner may not know in the last solve. Each is an outlier of the spectrum that costs a
#: few iterations, and soon more than a new set-up does.
_OUTLIERS = 3


def solve_contact(matrix, load, pairs, prescribed, start, solver, stages, scene=None):
    """Solve (K + k_N B^T B) u = L + k_N B^T D (1), updating the active set until it repeats itself.

    Collective on matrix.comm.

    Args:
        matrix: PETSc Mat, P^T K P not yet assembled; it is changed.
        load: (owned, 3) float64 external forces [N].
        pairs: NodePairs or None; without, one linear solve.
        prescribed: (owned, 3) float64 prescribed displacements [m], NaN where free.
        start: (owned, 3) float64 first guess [m]; its penetrations are the first guess of the active set.
        solver: Solver.
        stages: Stages, for the times.
        scene: Scene, to name the bodies that an active set leaves loose; None: not checked.

    Returns:
        ContactSolution.

    Raises:
        SolveError: a linear solve fails, the active sets cycle, there are too many of them, or nothing holds a body
            once the contact opens.
    """
    with stages("system"):
        term = PenaltyTerm(pairs, prescribed) if pairs is not None else None
        if term is not None:
            term.reserve(matrix)
        matrix.assemble()
        matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        matrix.setOption(PETSc.Mat.Option.SPD, True)
        base = _impose(matrix, load, prescribed)
        u = np.where(np.isnan(prescribed), start, prescribed)
        none = np.zeros(0 if pairs is None else len(pairs), dtype=bool)
        active = none if pairs is None else _first_guess(pairs, u)
        right_hand_side = base
        if term is not None:
            term.change(matrix, none, active)
            right_hand_side = base + term.right_hand_side(active)

    def changes(before, after):
        return matrix.comm.tompi4py().allreduce(int((before != after).sum()))

    cg = ConjugateGradients(matrix, solver)
    known = None  # the active set that the preconditioner knows
    tolerance = solver.tolerance if pairs is None else solver.loose_tolerance
    seen, updates = set(), 1
    while True:
        loose = loose_bodies(scene, pairs, active) if scene is not None and pairs is not None else []
        if loose:
            raise SolveError(
                f"nothing holds body {', '.join(map(repr, loose))} once the contact opens: only contact stops some of "
                "its rigid motions; prescribe displacements that stop them, or load it towards the contact"
            )
        if (
            known is None
            or cg.stops_paying()
            or (tolerance <= solver.tolerance and changes(known, active) > _OUTLIERS)
        ):
            with stages("setup"):
                cg.set_up()
            known = active
        with stages("solve"):
            u = cg.solve(right_hand_side, u, tolerance)
        if pairs is None:
            penetration = np.zeros(0)
            break
        penetration = pairs.penetration(u)
        after = _next_status(pairs, penetration, active, cg.energy_error * solver.tolerance / tolerance)
        if not changes(active, after):
            if tolerance <= solver.tolerance:
                break
            tolerance, seen = solver.tolerance, set()
            continue
        fingerprint = _fingerprint(pairs, after)
        if fingerprint in seen:
            if tolerance <= solver.tolerance:
                raise SolveError(
                    f"the active set cycles after {updates} updates: the same pairs open and close again and again; "
                    "use a finer mesh or a softer penalty"
                )
            tolerance, seen = solver.tolerance, set()
        seen.add(fingerprint)
        updates += 1
        if updates > solver.max_contact:
            raise SolveError(
                f"the active set still changes after {solver.max_contact} updates: apply less load at once"
            )
        with stages("system"):
            term.change(matrix, active, after)
            active = after
            right_hand_side = base + term.right_hand_side(active)
    iterations, energy_error = cg.iterations, cg.energy_error
    cg.destroy()
    force = np.where(active, pairs.stiffness * penetration, 0.0) if pairs is not None else np.zeros(0)
    return ContactSolution(u, active, force, penetration, updates, iterations, energy_error)


def _impose(matrix, load, prescribed):
    """Eliminate prescribed components symmetrically, identity rows scaled like the others; the right-hand side."""
    x, b = matrix.createVecs()
    x.array[:], b.array[:] = np.nan_to_num(prescribed).ravel(), load.ravel()
    rows = matrix.getOwnershipRange()[0] + np.flatnonzero(~np.isnan(prescribed).ravel()).astype(np.int32)
    scale = matrix.getDiagonal()
    matrix.zeroRowsColumns(rows, diag=scale.sum() / scale.getSize(), x=x, b=b)
    return b.array.reshape(-1, 3).copy()


def _first_guess(pairs, u):
    """Pairs that the first guess lets overlap; if there is none, those that are closest to touching."""
    penetration = pairs.penetration(u)
    comm = pairs.prolongation.comm
    deepest = comm.allreduce(float(penetration.max(initial=-np.inf)), op=MPI.MAX)
    return penetration > 0 if deepest > 0 else penetration >= deepest


def _next_status(pairs, penetration, active, noise):
    """Pairs that overlap.

    Within the linear solver's error, `noise` [J^(1/2)], a pair keeps its status; if no pair is pressed harder than
    that, the bodies at most touch without force, and all are open.
    """
    overlap = penetration * np.sqrt(pairs.stiffness)
    hardest = pairs.prolongation.comm.allreduce(float(overlap.max(initial=-np.inf)), op=MPI.MAX)
    return overlap > (np.where(active, -noise, noise) if hardest > noise else hardest)


def _fingerprint(pairs, active):
    """A number that tells active sets apart, the same on all ranks."""
    both = np.concatenate([pairs.first[active], pairs.second[active]]).astype(np.int32)
    first, second = pairs.prolongation.index_map.local_to_global(both).astype(np.uint64).reshape(2, -1)
    with np.errstate(over="ignore"):
        mixed = (first << np.uint64(32)) + second + np.uint64(1)
        mixed = mixed * np.uint64(0x9E3779B97F4A7C15)
        mixed = (mixed ^ mixed >> np.uint64(29)) * np.uint64(0xBF58476D1CE4E5B9)
        mine = int((mixed ^ mixed >> np.uint64(32)).sum() & np.uint64((1 << 48) - 1))
    return pairs.prolongation.comm.allreduce(mine)
