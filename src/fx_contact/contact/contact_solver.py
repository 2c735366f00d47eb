"""The contact loop over active sets."""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fx_contact.contact.active_set import ActiveSet
from fx_contact.contact.contact_problem import Environment
from fx_contact.contact.contact_system import ContactSystem, LinearSystem
from fx_contact.contact.initial_guess import relax
from fx_contact.contact.jump import Jump
from fx_contact.contact.penalty_term import PenaltyTerm
from fx_contact.linalg.conjugate_gradients import ROUNDING
from fx_contact.linalg.petsc_objects import PetscObjects
from fx_contact.parallel.errors import SolveError


@dataclass(frozen=True, eq=False)
class ContactSolution:
    """The end of the contact loop.

    Attributes:
        displacement: (owned, 3) float64, conforming [m].
        active: (n,) bool, status of this rank's rows.
        force: (n,) float64, contact force of each row, compression positive [N]; 0 where conditions hold all
            its vertices: they carry it.
        pressure: (n,) float64, as from `ConstraintRows.pressure` [Pa].
        penetration: (n,) float64, B u - D, positive where the bodies penetrate [m].
        contact_iterations: number of active sets tried, and of augmentations.
        krylov_iterations: of each linear solve.
        preconditioner: name of the one that the last solve used, as `ConjugateGradients` has it.
        energy_error: bound of the linear solver's error in the norm of the operator [J^(1/2)].
        rounding: energy norm (4) that rounding may leave of a rigid motion [J^(1/2)].
    """

    displacement: np.ndarray
    active: np.ndarray
    force: np.ndarray
    pressure: np.ndarray
    penetration: np.ndarray
    contact_iterations: int
    krylov_iterations: list[int]
    preconditioner: str
    energy_error: float
    rounding: float


def solve_contact(problem, start, options, stages):
    """The ContactSolution of `solve_system`, whose system is freed at once.

    Collective on problem.matrix.comm.

    Args:
        problem, start, options: as in `solve_system`.
        stages: Stages, for the times.
    """
    with PetscObjects(problem.matrix.mat, problem.coarse) as objects:
        return solve_system(problem, start, options, Environment(stages, objects))[0]


def solve_system(problem, start, options, environment):
    """Solve a contact problem: PCG for each active set, until the set repeats itself.

    Collective on problem.matrix.comm.

    Args:
        problem: ContactProblem.
        start: (owned, 3) float64, first guess of the displacement [m]; its penetrations are that of the active set.
        options: SolveOptions.
        environment: Environment.

    Returns:
        ContactSolution, and for dual solutions the ContactSystem of the closed rows, or LinearSystem without contact.

    Raises:
        SolveError: a linear solve fails, there are too many active sets or augmentations, nothing holds a body once
            the contact opens, or conditions press nodes into each other.
    """
    rows, stages, matrix = problem.rows, environment.stages, problem.matrix.mat
    u = problem.supports.admissible(start)
    with stages("system"):
        jump = None if rows is None else Jump(rows, problem.supports)
        if jump is not None:
            PenaltyTerm(jump).reserve(matrix)
        matrix.assemble()
        base, scale = _impose(matrix, problem.load, problem.supports)
    if jump is None:
        u, system = _solve_linear(problem, base, u, options, environment)
        active, (force, pressure, penetration), count = np.zeros(0, dtype=bool), np.zeros((3, 0)), 1
    else:
        with stages("solve"):
            carried = problem.matrix.comm.allreduce(bool(start.any()), op=MPI.LOR)
            status, u = _first_guess(problem, base, jump, u, options, carried)
        with stages("system"):
            system = ContactSystem(problem, base, jump, status.active, options, environment)
        u, trial, count = _settle(system, status, u, options)
        active, penetration = status.active, rows.penetration(u)
        force = np.where(active & jump.movable, trial, 0.0)
        pressure = rows.pressure(force)
    rounding = ROUNDING * float(np.sqrt(problem.matrix.comm.allreduce(float(((scale * u) ** 2).sum()))))
    solution = ContactSolution(
        displacement=u,
        active=active,
        force=force,
        pressure=pressure,
        penetration=penetration,
        contact_iterations=count,
        krylov_iterations=list(system.iterations),
        preconditioner=system.preconditioner,
        energy_error=system.noise,
        rounding=rounding,
    )
    return solution, system


def _solve_linear(problem, base, u, options, environment):
    """The displacement without contact, and the LinearSystem that found it."""
    stages = environment.stages
    with stages("system"):
        cg = problem.linear_solver(options.solver, environment.objects)
    with stages("setup"):
        cg.set_up()
    with stages("solve"):
        system = LinearSystem(cg, problem.supports, options.solver)
        return system.solve(base, u, options.solver.tolerance), system


def _first_guess(problem, base, jump, u, options, carried):
    """The first ActiveSet, whose springs the matrix then has, and a displacement close to its own.

    Args:
        carried: whether u comes from another mesh: then both are relaxed.
    """
    rows, matrix = problem.rows, problem.matrix.mat
    status = ActiveSet(rows, problem.scene, u, options.solver.max_contact)
    bounded = PenaltyTerm(jump, rows.bounded_stiffness)
    if problem.motions is not None:
        stiffness = status.active * rows.bounded_stiffness
        u = problem.motions.move(matrix, base, jump, stiffness, u, problem.supports)
    bounded.change(matrix, np.zeros_like(status.active), status.active)
    if carried and problem.volume is None:  # the matrix alone is too soft
        u = relax(matrix, base, bounded, u, status)
        status.forget()
    return status, u


def _settle(system, status, u, options):
    """Change the active set until it repeats itself.

    There are two states, the tolerances of the linear solver: loose, then tight.  After a solve, the first that holds:

        the set is not the one wanted        -> change it, solve again    (a cycle ends the loose state instead)
        the penalty leaves a penetration     -> augment forces, solve again
        the state is loose                   -> tight, solve again
        the state is tight                   -> done

    Returns:
        displacement (owned, 3) float64 [m], trial forces (n,) float64 [N], number of active sets and augmentations.
    """
    solver, augmentations = options.solver, 0
    tolerance = solver.loose_tolerance
    while True:
        u = system.solve(status.active, u, tolerance)
        trial = system.trial(u)
        system.check_apart(trial, u)
        loose = tolerance > solver.tolerance
        wanted = status.wanted(trial, system.noise * solver.tolerance / tolerance)
        if status.differs(wanted) and not (loose and status.cycles(wanted)):
            status.update(wanted)
        elif system.augment(trial, u):
            augmentations += 1
            if augmentations > solver.max_contact:
                raise SolveError(
                    f"{solver.max_contact} augmentations have not brought the penetration below the gap tolerance "
                    f"{options.enforcement.gap_tolerance:g}; use a larger penalty factor or the enforcement 'exact'"
                )
        elif loose:
            tolerance = solver.tolerance
            status.forget()
        else:
            status.check_held()
            return u, trial, status.updates + augmentations


def _impose(matrix, load, supports):
    """Eliminate what is held symmetrically, identity rows scaled like the others.

    Returns:
        (owned, 3) float64 right-hand side [N], and the roots of the diagonal.

    Raises:
        SolveError: the matrix is not finite.
    """
    with PetscObjects() as objects:
        x, b = map(objects.add, matrix.createVecs())
        x.array[:], b.array[:] = supports.values.ravel(), supports.along_planes(load).ravel()
        rows = matrix.getOwnershipRange()[0] + np.flatnonzero(~supports.free.ravel()).astype(np.int32)
        diagonal = objects.add(matrix.getDiagonal())
        scale = diagonal.sum() / diagonal.getSize()
        if not (np.isfinite(scale) and scale > 0 and np.isfinite(b.norm())):
            raise SolveError(
                "the stiffness or the load is not a finite number: check the units of moduli and lengths"
            )
        supports.add_normal_part(matrix, diagonal.array.reshape(-1, 3))
        matrix.zeroRowsColumns(rows, diag=scale, x=x, b=b)
        return b.array.reshape(-1, 3).copy(), np.sqrt(np.abs(diagonal.array)).reshape(-1, 3)
