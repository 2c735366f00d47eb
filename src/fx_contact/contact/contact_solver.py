"""The contact loop over active sets."""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fx_contact.contact.active_set import ActiveSet
from fx_contact.contact.contact_problem import ContactProblem, SolveOptions
from fx_contact.contact.contact_system import ContactSystem, LinearSystem
from fx_contact.contact.initial_guess import relax
from fx_contact.contact.jump import Jump
from fx_contact.contact.penalty_term import PenaltyTerm, reserve
from fx_contact.fem.supports import Supports
from fx_contact.linalg.operator import Array, Mask
from fx_contact.linalg.petsc_objects import PetscObjects
from fx_contact.linalg.solver_options import Solver
from fx_contact.linalg.stopping import ROUNDING
from fx_contact.parallel.errors import SolveError
from fx_contact.parallel.timing import Stages


@dataclass(frozen=True, eq=False)
class ContactSolution:
    """The end of the contact loop, on this rank's nodes and rows.

    Attributes:
        displacement: (owned, 3), conforming [m].
        active: (n,), closed rows.
        force: (n,), contact force of each row, compression positive [N]; 0 where conditions hold all its vertices: they
            carry it.
        pressure: (n,), as from `ConstraintRows.pressure` [Pa].
        penetration: (n,), B u - D, positive where the bodies penetrate [m].
        contact_iterations: number of active sets tried.
        krylov_iterations: of each linear solve.
        preconditioner: name of that of the last solve, as `LinearSolver` has it.
        energy_error: bound of the linear solver's error in the norm of the operator [J^(1/2)].
        rounding: energy norm (4) that rounding may leave of a rigid motion [J^(1/2)].
    """

    displacement: Array
    active: Mask
    force: Array
    pressure: Array
    penetration: Array
    contact_iterations: int
    krylov_iterations: list[int]
    preconditioner: str
    energy_error: float
    rounding: float


def solve_contact(problem: ContactProblem, start: Array, options: SolveOptions, stages: Stages) -> ContactSolution:
    """The solution of `solve_system`, whose system is freed.  Collective on problem.matrix.comm."""
    with PetscObjects(problem.matrix.mat, problem.coarse) as objects:
        return solve_system(problem, start, options, stages, objects)[0]


def solve_system(
    problem: ContactProblem, start: Array, options: SolveOptions, stages: Stages, objects: PetscObjects
) -> tuple[ContactSolution, ContactSystem | LinearSystem]:
    """Solve a contact problem: a linear system for each active set, until the set repeats itself.

    Collective on problem.matrix.comm.

    Args:
        problem: its matrix is used up.
        start: (owned, 3), first guess of the displacement, whose penetrations are the first active set [m].
        options: of the user.
        stages: for the times.
        objects: free the system.

    Returns:
        The solution, and the system of the closed rows for dual solutions.

    Raises:
        SolveError: a linear solve fails, there are too many active sets, nothing holds a body once the contact opens,
            or conditions press nodes into each other.
    """
    rows, matrix, comm = problem.rows, problem.matrix.mat, problem.matrix.comm
    system: ContactSystem | LinearSystem
    u = problem.supports.admissible(start)
    with stages("system"):
        jump = None if rows is None else Jump(rows, problem.supports)
        if jump is not None:
            reserve(matrix, jump)
        matrix.assemble()
        load, root = _impose(matrix, problem.load, problem.supports)
    if rows is None or jump is None:
        u, system = _solve_linear(problem, load, u, options.solver, stages, objects)
        active, (force, pressure, penetration), count = np.zeros(0, dtype=bool), np.zeros((3, 0)), 1
    else:
        with stages("solve"):
            carried = comm.allreduce(bool(start.any()), op=MPI.LOR)
            status, u = _first_guess(problem, load, jump, u, options.solver, carried)
        with stages("system"):
            system = ContactSystem(problem, load, jump, status.active, options, stages, objects)
        u, trial = _find_active_set(system, status, u, options.solver)
        active, penetration, count = status.active, rows.penetration(u), status.updates
        force = np.where(active & jump.movable, trial, 0.0)
        pressure = rows.pressure(force)
    solution = ContactSolution(
        displacement=u,
        active=active,
        force=force,
        pressure=pressure,
        penetration=penetration,
        contact_iterations=count,
        krylov_iterations=list(system.solver.iterations),
        preconditioner=system.solver.preconditioner,
        energy_error=system.solver.energy_error,
        rounding=ROUNDING * float(np.sqrt(comm.allreduce(float(((root * u) ** 2).sum())))),
    )
    return solution, system


def _solve_linear(
    problem: ContactProblem, load: Array, u: Array, options: Solver, stages: Stages, objects: PetscObjects
) -> tuple[Array, LinearSystem]:
    """The displacement without contact, and its system."""
    with stages("system"):
        solver = problem.linear_solver(options, objects)
    with stages("setup"):
        solver.set_up()
    with stages("solve"):
        system = LinearSystem(solver, problem.supports, options)
        return system.solve(load, u, options.tolerance), system


def _first_guess(
    problem: ContactProblem, load: Array, jump: Jump, u: Array, options: Solver, carried: bool
) -> tuple[ActiveSet, Array]:
    """The first active set, whose capped penalty term the matrix then has, and a displacement close to its own.

    Bodies without displacement are moved as a whole; a displacement carried from another mesh is relaxed.
    """
    rows, matrix = jump.rows, problem.matrix.mat
    status = ActiveSet(rows, problem.scene, u, options.max_contact)
    capped = PenaltyTerm(jump, rows.capped_stiffness)
    if problem.motions is not None:
        u = problem.motions.move(matrix, load, jump, status.active * rows.capped_stiffness, u, problem.supports)
    capped.of(status.active).add_to(matrix)
    if carried and problem.volume is None:  # the matrix alone is too soft
        u = relax(matrix, load, capped, u, status)
        status.reset_cycles()
    return status, u


def _find_active_set(system: ContactSystem, status: ActiveSet, u: Array, options: Solver) -> tuple[Array, Array]:
    """Change the active set until it repeats itself: with the loose tolerance of the linear solver, then the tight one.

    A cycle ends the loose phase.

    Returns:
        Displacement (owned, 3) [m] and trial forces (n,) [N].
    """
    tolerance = options.loose_tolerance
    while True:
        u = system.solve(status.active, u, tolerance)
        trial = system.trial(u)
        system.check_apart(trial, u)
        loose = tolerance > options.tolerance
        wanted = status.wanted(trial, system.solver.energy_error * options.tolerance / tolerance)
        if status.differs(wanted) and not (loose and status.cycles(wanted)):
            status.update(wanted)
        elif loose:
            tolerance = options.tolerance
            status.reset_cycles()
        else:
            status.check_held()
            return u, trial


def _impose(matrix: PETSc.Mat, load: Array, supports: Supports) -> tuple[Array, Array]:
    """Eliminate held unknowns symmetrically, with identity rows scaled like the others.

    Returns:
        Right-hand side [N], and the roots of the diagonal, both (owned, 3).

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
