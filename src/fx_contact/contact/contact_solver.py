"""The contact loop over active sets."""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fx_contact.contact.active_set import ActiveSet
from fx_contact.contact.contact_system import ContactSystem
from fx_contact.contact.enforcement import Jump, PenaltyTerm
from fx_contact.contact.initial_guess import relax
from fx_contact.linalg.conjugate_gradients import ROUNDING, ConjugateGradients
from fx_contact.linalg.petsc_objects import PetscObjects
from fx_contact.parallel.errors import SolveError


@dataclass(frozen=True, eq=False)
class ContactSolution:
    """The end of the contact loop.

    Attributes:
        displacement: (owned, 3) float64, conforming [m].
        active: (n,) bool, status of this rank's node pairs.
        force: (n,) float64, contact force of each pair, compression positive [N]; none where conditions hold both
            vertices across the contact: they carry it.
        penetration: (n,) float64, positive where the bodies overlap [m].
        contact_iterations: number of active sets tried, and of augmentations.
        krylov_iterations: of each linear solve.
        preconditioner: name of the one that the last solve used, as `ConjugateGradients` has it.
        energy_error: how far the linear solver may be from the solution in the operator's norm [J^(1/2)].
        rounding: what rounding may leave of a rigid motion in the energy norm (4) [J^(1/2)].
    """

    displacement: np.ndarray
    active: np.ndarray
    force: np.ndarray
    penetration: np.ndarray
    contact_iterations: int
    krylov_iterations: list[int]
    preconditioner: str
    energy_error: float
    rounding: float


def solve_contact(matrix, *arguments):
    """The ContactSolution of `solve_system`, whose system is freed at once.  Collective; arguments as there."""
    with PetscObjects(matrix.mat) as objects:
        return solve_system(objects, matrix, *arguments)[0]


def solve_system(
    objects,
    matrix,
    load,
    pairs,
    prescribed,
    start,
    energy_norm,
    solver,
    stages,
    enforcement=None,
    scene=None,
    motions=None,
):
    """Solve K u + B^T f = L with f >= 0, B u <= D, f (B u - D) = 0, the latter as the enforcement has it.

    Collective on matrix.mat.comm.  Active sets change until one repeats itself; the linear systems are solved loosely
    until then.

    Args:
        objects: PetscObjects, with which the system is freed.
        matrix: BlockMatrix, P^T K P not yet assembled; it is used up.
        load: (owned, 3) float64 external forces [N].
        pairs: NodePairs or None; without, one linear solve.
        prescribed: (owned, 3) float64 prescribed displacements [m], NaN where free.
        start: (owned, 3) float64 first guess [m]; its penetrations are the first guess of the active set.
        energy_norm: function of a displacement (owned, 3) float64 [m], its energy norm omega (4) [J^(1/2)]; collective.
        solver: Solver.
        stages: Stages, for the times.
        enforcement: Enforcement, with which the pairs were made; None without pairs.
        scene: Scene, to name the bodies that an active set leaves loose; None: not checked.
        motions: RigidMotions, of bodies that are at rest and are to be moved as a whole first; None: they stay.

    Returns:
        ContactSolution, and the ContactSystem of the closed pairs, None without pairs.

    Raises:
        SolveError: a linear solve fails, there are too many active sets or augmentations, nothing holds a body once
            the contact opens, or conditions press vertices into each other.
    """
    u = np.where(np.isnan(prescribed), start, prescribed)
    with stages("system"):
        jump = None if pairs is None else Jump(pairs, prescribed)
        if pairs is not None:
            PenaltyTerm(jump).reserve(matrix.mat)
        matrix.mat.assemble()
        base, scale = _impose(matrix.mat, load, prescribed)
    if pairs is None:
        return _solve_linear(matrix, base, u, energy_norm, solver, stages, scale, objects), None
    with stages("solve"):
        status = ActiveSet(pairs, scene, u, solver.max_contact)
        bounded = PenaltyTerm(jump, pairs.bounded_stiffness)
        if motions is not None:
            stiffness = status.active * pairs.bounded_stiffness
            u = motions.move(matrix.mat, base, jump, stiffness, u, np.isnan(prescribed))
        bounded.change(matrix.mat, np.zeros_like(status.active), status.active)
        if pairs.prolongation.comm.allreduce(bool(start.any()), op=MPI.LOR):
            u = relax(matrix.mat, base, bounded, u, status)
            status.forget()
    with stages("system"):
        linear = ContactSystem(matrix, base, jump, status.active, energy_norm, solver, enforcement, stages, objects)

    tolerance, augmentations = solver.loose_tolerance, 0
    while True:
        u = linear.solve(status.active, u, tolerance)
        trial = linear.trial(u)
        linear.check_apart(trial, u)
        wanted = status.wanted(trial, linear.noise * solver.tolerance / tolerance)
        if status.differs(wanted) and not (tolerance > solver.tolerance and status.cycles(wanted)):
            status.update(wanted)
        elif linear.augment(trial, u):
            augmentations += 1
            if augmentations > solver.max_contact:
                raise SolveError(
                    f"{solver.max_contact} augmentations have not brought the penetration below the gap tolerance "
                    f"{enforcement.gap_tolerance:g}; use a larger penalty factor or the enforcement 'exact'"
                )
        elif tolerance > solver.tolerance:
            tolerance = solver.tolerance
            status.forget()
        else:
            status.check_held()
            force = np.where(status.active & jump.movable, trial, 0.0)
            break
    solution = ContactSolution(
        u,
        status.active,
        force,
        pairs.penetration(u),
        status.updates + augmentations,
        list(linear.iterations),
        linear.preconditioner,
        linear.noise,
        _rounding(u, scale, pairs.prolongation.comm),
    )
    return solution, linear


def _solve_linear(matrix, base, u, energy_norm, solver, stages, scale, objects):
    """The solution without contact."""
    with stages("system"):
        cg = ConjugateGradients(matrix, solver, energy_norm, objects)
    with stages("setup"):
        cg.set_up()
    with stages("solve"):
        u = cg.solve(base, u, solver.tolerance)
    none, rounding = np.zeros(0), _rounding(u, scale, matrix.comm)
    return ContactSolution(
        u, none.astype(bool), none, none, 1, cg.iterations, cg.preconditioner, cg.energy_error, rounding
    )


def _rounding(u, scale, comm):
    """What rounding leaves of a displacement in the energy norm, from the roots of the stiffness' diagonal."""
    return ROUNDING * float(np.sqrt(comm.allreduce(float(((scale * u) ** 2).sum()))))


def _impose(matrix, load, prescribed):
    """Eliminate prescribed components symmetrically, identity rows scaled like the others.

    Returns:
        (owned, 3) float64 right-hand side [N], and the roots of the diagonal.

    Raises:
        SolveError: the matrix is not finite.
    """
    with PetscObjects() as objects:
        x, b = map(objects.add, matrix.createVecs())
        x.array[:], b.array[:] = np.nan_to_num(prescribed).ravel(), load.ravel()
        rows = matrix.getOwnershipRange()[0] + np.flatnonzero(~np.isnan(prescribed).ravel()).astype(np.int32)
        diagonal = objects.add(matrix.getDiagonal())
        scale = diagonal.sum() / diagonal.getSize()
        if not (np.isfinite(scale) and scale > 0 and np.isfinite(b.norm())):
            raise SolveError(
                "the stiffness or the load is not a finite number: check the units of moduli and lengths"
            )
        matrix.zeroRowsColumns(rows, diag=scale, x=x, b=b)
        return b.array.reshape(-1, 3).copy(), np.sqrt(np.abs(diagonal.array)).reshape(-1, 3)
