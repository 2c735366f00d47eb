"""The contact loop over active sets."""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fx_contact.contact import PenaltyTerm, loose_bodies
from fx_contact.errors import SolveError
from fx_contact.krylov import ConjugateGradients


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

    Collective on matrix.mat.comm.

    Args:
        matrix: BlockMatrix, P^T K P not yet assembled; it is used up.
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
            term.reserve(matrix.mat)
        matrix.mat.assemble()
        base = _impose(matrix.mat, load, prescribed)
        u = np.where(np.isnan(prescribed), start, prescribed)
        none = np.zeros(0 if pairs is None else len(pairs), dtype=bool)
        active = none if pairs is None else _first_guess(pairs, u)
        right_hand_side = base
        if term is not None:
            term.change(matrix.mat, none, active)
    updates, seen = 1, set()
    if term is not None:
        with stages("solve"):
            u, active, updates = _relax(matrix.mat, base, term, u, active)
            right_hand_side = base + term.right_hand_side(active)
    with stages("system"):
        cg = ConjugateGradients(matrix, solver)

    known = None  # the active set in the matrix, which the preconditioner knows
    tolerance = solver.tolerance if pairs is None else solver.loose_tolerance
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
            or (tolerance <= solver.tolerance and _changes(pairs, known, active) > _OUTLIERS)
        ):
            with stages("setup"):
                if known is not None:
                    term.change(cg.matrix, known, active)
                cg.set_up()
            known = active
        with stages("solve"):
            u = cg.solve(right_hand_side, u, tolerance)
        if pairs is None:
            penetration = np.zeros(0)
            break
        penetration = pairs.penetration(u)
        after = _next_status(pairs, penetration, active, cg.energy_error * solver.tolerance / tolerance)
        if not _changes(pairs, active, after):
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
            active = after
            cg.correct(term.difference(known, active))
            right_hand_side = base + term.right_hand_side(active)
    iterations, energy_error = cg.iterations, cg.energy_error
    cg.destroy()
    force = np.where(active, pairs.stiffness * penetration, 0.0) if pairs is not None else np.zeros(0)
    return ContactSolution(u, active, force, penetration, updates, iterations, energy_error)


#: Iterations between two looks at the active set, and most looks, before hypre is set up.
_RELAXATION, _LOOKS = 15, 5


def _relax(matrix, base, term, u, active):
    """Settle the active set as far as a few iterations with block Jacobi can, and improve the first guess.

    A displacement carried from a coarser mesh errs most from one node to the next, just where contact ends.  That
    error is gone after few cheap iterations; the active set that is left is mostly the last one, and hypre is set up
    for it once.

    Returns:
        displacement (owned, 3), active pairs (n,), and the number of active sets tried.
    """
    pairs = term.pairs
    ksp = PETSc.KSP().create(matrix.comm)
    ksp.setType(PETSc.KSP.Type.CG)
    ksp.getPC().setType(PETSc.PC.Type.PBJACOBI)
    ksp.setNormType(PETSc.KSP.NormType.NONE)
    ksp.setInitialGuessNonzero(True)
    ksp.setTolerances(max_it=_RELAXATION)
    x, b = matrix.createVecs()
    x.array[:] = u.ravel()
    for look in range(1, _LOOKS + 1):
        b.array[:] = (base + term.right_hand_side(active)).ravel()
        ksp.setOperators(matrix)
        ksp.solve(b, x)
        u = x.array.reshape(-1, 3).copy()
        after = _next_status(pairs, pairs.penetration(u), active, 0.0)
        if not _changes(pairs, active, after):
            break
        term.change(matrix, active, after)
        active = after
    for thing in (ksp, x, b):
        thing.destroy()
    return u, active, look


def _changes(pairs, before, after):
    """Number of pairs on all ranks whose status differs."""
    return pairs.prolongation.comm.allreduce(int((before != after).sum()))


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
