"""The contact loop over active sets."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from fx_contact.contact.constraint_rows import ConstraintRows, Role
from fx_contact.contact.contact_problem import ContactProblem, SolveOptions
from fx_contact.contact.contact_system import ContactSystem, LinearSystem
from fx_contact.contact.jump import Jump
from fx_contact.contact.penalty_term import PenaltyTerm, reserve
from fx_contact.contact.row_motions import RowMotions
from fx_contact.fem.body_motions import FreeMotions
from fx_contact.law.active_set import solve_law
from fx_contact.law.free_motions import LoadedMotions, driven_error
from fx_contact.law.initial_guess import move_bodies, relax
from fx_contact.law.settling import settle
from fx_contact.law.tangents import tangential_vectors
from fx_contact.law.unilateral import Unilateral
from fx_contact.linalg.operator import MatrixOperator
from fx_contact.linalg.petsc_objects import PetscObjects
from fx_contact.linalg.stopping import ROUNDING
from fx_contact.parallel.arrays import BoolArray, FloatArray
from fx_contact.parallel.errors import SolveError
from fx_contact.parallel.mpi import any_true
from fx_contact.parallel.timing import Stages


@dataclass(frozen=True, eq=False)
class ContactSolution:
    """Result of the contact loop; n normals, which come first among all rows, and m tangents and equations.

    Attributes:
        rows: of the problem, or where the obstacles have settled; None without contact.
        displacement: (owned, 3), conforming [m].
        still: (owned, 3), without `free_motions` [m].
        active: (n,), closed rows.
        pressure: (n,), `ConstraintRows.pressure` [Pa].
        penetration: (n,), B u - D, positive where the bodies penetrate [m].
        contact_iterations: number of active sets.
        krylov_iterations: of each linear solve.
        preconditioner: of the last solve, as `LinearSolver.preconditioner`.
        row_force: (n + m,), of all rows, of the first side on the second along their directions; 0 in rows whose nodes
            are all constrained [N].
        motions: found along given forces, by the names of interfaces, as in `StepRecord.motions`.
        free_motions: bodies that nothing holds and no load moves, by name, and how they could.
        slip: (n + m,), d of the load step in tangents of closed normals, else 0 [m].
        slipping: (n,), closed normals whose tangents slip.
        closed_anew: (n,), closed normals that were open before the load step; without friction none.
        traction: (n, 3), tangential forces over the areas f_n / p, with the sign of `row_force`; None: no friction
            [Pa].
        yielded_rows: number of all ranks' rows that are left out, or prescribed, by conditions, ties or contacts before
            theirs (`contact.precedence`).
        energy_error: bound of the linear solver's error in the energy norm [J^(1/2)].
        rounding: bound of the energy norm (4) of a rigid motion, by rounding [J^(1/2)].
    """

    rows: ConstraintRows | None
    displacement: FloatArray
    still: FloatArray
    active: BoolArray
    pressure: FloatArray
    penetration: FloatArray
    contact_iterations: int
    krylov_iterations: list[int]
    preconditioner: str
    row_force: FloatArray
    slip: FloatArray
    slipping: BoolArray
    closed_anew: BoolArray
    traction: FloatArray | None
    motions: dict[str, float | list[float]]
    free_motions: dict[str, str]
    yielded_rows: int
    energy_error: float
    rounding: float

    @property
    def force(self) -> FloatArray:
        """(n,), contact forces, compression positive [N]."""
        return self.row_force[: len(self.active)]

    @property
    def slides(self) -> BoolArray:
        """(n,), closed normals that slip, or have no friction.  Local."""
        assert self.rows is not None, "of a scene with contact"
        count, rows = len(self.active), self.rows
        rough = np.isin(rows.contact[:count], rows.contact[rows.role == Role.TANGENT])
        return self.slipping | (self.active & ~rough)

    @property
    def slip_vector(self) -> FloatArray:
        """(n, 3), slip of the first side on the second in the load step, of closed normals [m].  Local."""
        assert self.rows is not None, "of a scene with contact"
        return tangential_vectors(self.rows, self.slip)


def _tractions(rows: ConstraintRows, force: FloatArray, pressure: FloatArray) -> FloatArray:
    """Tangential tractions (n, 3) [Pa] by forces of all rows, over the areas f_n / p."""
    normal = rows.role == Role.NORMAL
    closed = (force[normal] > 0) & (pressure > 0)
    per_area = np.divide(pressure, force[normal], out=1 / rows.area[normal], where=closed)
    return per_area[:, None] * tangential_vectors(rows, force)


def solve_contact(
    problem: ContactProblem, start: FloatArray, options: SolveOptions, stages: Stages
) -> ContactSolution:
    """The solution of `solve_system`, whose system is freed.

    Collective on problem.matrix.comm.  Raises SolveError as `solve_system`.
    """
    with PetscObjects(problem.matrix.mat, problem.coarse) as objects:
        return solve_system(problem, start, options, stages, objects)[0]


def solve_system(
    problem: ContactProblem, start: FloatArray, options: SolveOptions, stages: Stages, objects: PetscObjects
) -> tuple[ContactSolution, ContactSystem | LinearSystem]:
    """Solve a contact problem: a linear system for each active set, until the set repeats itself.

    Collective on problem.matrix.comm.

    Args:
        start: (owned, 3), first guess, whose penetrations are the first active set [m].
        objects: free the system, which owns the matrix.

    Returns:
        The solution, and the system of the closed rows for dual solutions.

    Raises:
        SolveError: a linear solve fails, too many active sets, an unconstrained body, prescribed penetrations, or an
            obstacle that does not settle.
    """
    rows, matrix, comm = problem.rows, problem.matrix.mat, problem.matrix.comm
    system: ContactSystem | LinearSystem
    motions: dict[str, float | list[float]] = {}
    with stages("system"):
        jump = None if rows is None else Jump(rows, problem.supports)
        if jump is not None:
            reserve(matrix, jump)
        matrix.assemble()
        load, root = _impose(problem)
    if rows is None or jump is None:
        free, left_out = _without_contact(problem)
        system = LinearSystem(problem, options.solver, stages, objects, left_out)
        with stages("solve"):
            u = system.solve(load, problem.supports.admissible(start), options.solver.tolerance)
        error, of_rows, still = system.solver.energy_error, _WITHOUT_ROWS, u
    else:
        with stages("solve"):
            constant = RowMotions.of(rows, turning=False)
            capped = PenaltyTerm(jump, np.where(constant.moving, 0.0, rows.capped_stiffness))
            law, u = _first_guess(problem, load, capped, start, options)
        with stages("system"):
            system = ContactSystem(problem, load, jump, capped.of(law.active).stiffness, options, stages, objects)
        if problem.rows_at is None:
            u, trial = solve_law(system, law, u, options.solver)
            error = system.solver.energy_error
        else:
            distances, jump, u, trial, error = settle(problem, jump, system, law, u, options.solver)
            rows = jump.rows
            motions |= RowMotions.of(rows, turning=True).entries(distances)
        law.check_supported()
        free, still = law.free_motions(u)
        motions |= constant.entries(constant.found(rows.penetration(u)))
        of_rows = _of_rows(law, jump.movable, rows, u, trial)
    solution = ContactSolution(
        rows=rows,
        displacement=u,
        still=still,
        krylov_iterations=list(system.solver.iterations),
        preconditioner=system.solver.preconditioner,
        motions=motions,
        free_motions=free,
        energy_error=error,
        rounding=ROUNDING * float(np.sqrt(comm.allreduce(float(((root * u) ** 2).sum())))),
        **of_rows,
    )
    return solution, system


#: Entries of a `ContactSolution` without rows.
_WITHOUT_ROWS: dict[str, Any] = {
    **dict.fromkeys(("active", "slipping", "closed_anew"), np.zeros(0, dtype=bool)),
    **dict.fromkeys(("pressure", "penetration", "row_force", "slip"), np.zeros(0)),
    **{"contact_iterations": 1, "yielded_rows": 0, "traction": None},
}


def _of_rows(
    law: Unilateral, movable: BoolArray, rows: ConstraintRows, u: FloatArray, trial: FloatArray
) -> dict[str, Any]:
    """Entries of a `ContactSolution` by its displacement (owned, 3) [m] and trial forces (n,) [N].  Collective."""
    normal, pressing = law.normal, law.springs().closed | (rows.role == Role.TANGENT)
    force = np.where(pressing & movable, trial, 0.0)
    pressure = rows.part(Role.NORMAL).pressure(force[normal])
    return {
        "active": law.active[normal],
        "pressure": pressure,
        "traction": _tractions(rows, force, pressure) if law.slides else None,
        "penetration": rows.penetration(u)[normal],
        "contact_iterations": law.updates,
        "row_force": force,
        "slip": law.slip(u),
        "slipping": law.slipping()[normal],
        "closed_anew": law.closed_anew(u)[normal],
        "yielded_rows": rows.prolongation.comm.allreduce(rows.yielded + int(np.count_nonzero(~movable))),
    }


def _first_guess(
    problem: ContactProblem, load: FloatArray, capped: PenaltyTerm, start: FloatArray, options: SolveOptions
) -> tuple[Unilateral, FloatArray]:
    """First active set, its part of a penalty term added to the matrix, and a displacement close to its solution."""
    jump, matrix = capped.jump, problem.matrix.mat
    rows, u = jump.rows, problem.supports.admissible(start)
    carried = any_true(problem.matrix.comm, start != 0)
    exact, most = options.enforcement.method == "exact", options.solver.max_contact
    bodies, loaded = problem.bodies, None
    if bodies is not None and len(bodies.rigid.free):
        loaded = LoadedMotions(bodies, problem.load, matrix, RowMotions.of(rows, turning=False).loads)
    status = Unilateral(rows, loaded, u, most, exact, problem.before)
    if bodies is not None and not carried:
        u = move_bodies(bodies, matrix, load, jump, status.active * rows.capped_stiffness, u)
    capped.of(status.active).add_to(matrix)
    if carried and problem.volume is None:  # the matrix alone is too soft
        u = relax(matrix, load, capped, u, status, rows.prolongation.space.degree)
        status.reset_cycles()
    return status, u


def _without_contact(problem: ContactProblem) -> tuple[dict[str, str], FreeMotions | None]:
    """Free motions of bodies without contact, by name, and what leaves them out.  Collective.

    Raises SolveError: a load moves them.
    """
    if problem.bodies is None or not len(problem.bodies.rigid.free):
        return {}, None
    loaded = LoadedMotions(problem.bodies, problem.load, problem.matrix.mat)
    loose = np.eye(len(problem.bodies.rigid.free))
    free = loaded.free(loose)
    if driven := loaded.driven(free, loose):
        raise driven_error(driven)
    return loaded.named(free), loaded.left_out(free)


def _impose(problem: ContactProblem) -> tuple[FloatArray, FloatArray]:
    """The right-hand side with prescribed displacements [N], and the roots of the diagonal, both (owned, 3)."""
    matrix, supports = problem.matrix.mat, problem.supports
    if problem.matrix.held is None:
        raise SolveError("the matrix is made without supports: Elasticity.stiffness(supports=...) eliminates them")
    load = supports.free_part(problem.load - problem.matrix.held)
    with PetscObjects() as objects:
        diagonal = MatrixOperator(matrix, objects).diagonal()
    comm = problem.matrix.comm
    total = comm.allreduce(float(diagonal.sum()))
    finite = np.isfinite(total) and total > 0 and np.isfinite(load).all()
    if any_true(comm, np.array(not finite)):
        raise SolveError("the stiffness or the load is not a finite number: check the units of moduli and lengths")
    supports.add_normal_part(matrix, diagonal)
    return np.where(supports.free, load, diagonal * supports.values), np.sqrt(np.abs(diagonal))
