"""The linear system of rows with springs and forces, whose preconditioner outlives changes of their status."""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fx_contact.contact.constraint_rows import ConstraintRows, Role
from fx_contact.contact.contact_problem import ContactProblem, SolveOptions
from fx_contact.contact.jump import Jump
from fx_contact.contact.penalty_term import MatrixPenalty, PenaltyTerm
from fx_contact.contact.projection import Projection
from fx_contact.contact.row_motions import RowMotions
from fx_contact.fem.body_motions import FreeMotions
from fx_contact.linalg.operator import Equations, Projector
from fx_contact.linalg.petsc_objects import PetscObjects
from fx_contact.linalg.solver_options import Solver
from fx_contact.parallel.arrays import BoolArray, FloatArray
from fx_contact.parallel.errors import SolveError
from fx_contact.parallel.mpi import any_true
from fx_contact.parallel.timing import Stages

#: Errors of penetrations and gaps of closed rows: of the linear solver, relative to the approach (100 times its
#: default tolerance); by rounding, relative to the largest displacement (1e4 times that of a double).
_OF_APPROACH, _OF_DISPLACEMENT = 1e-6, 1e-12


@dataclass(frozen=True, eq=False)
class Springs:
    """Forces f = k (B u - D - s) + g of the rows (n,) in a linear system, compression positive.

    Attributes:
        stiffness: k, inf for B u = D + s, 0 of open rows [N/m].
        shift: s; None on all ranks: 0 [m].
        force: g, also where k is 0; None on all ranks: 0 [N].
        free: motions that the displacement leaves out; None: there are none.
    """

    stiffness: FloatArray
    shift: FloatArray | None = None
    force: FloatArray | None = None
    free: FreeMotions | None = None

    @property
    def closed(self) -> BoolArray:
        """(n,), rows with a spring or an equation."""
        return np.asarray(self.stiffness > 0)

    def __add__(self, other: "Springs") -> "Springs":
        """Both together, each in rows of its own."""
        both = ((self.shift, other.shift), (self.force, other.force))
        shift, force = (b if a is None else a if b is None else a + b for a, b in both)
        return Springs(self.stiffness + other.stiffness, shift, force, self.free)


class LinearSystem:
    """K u = L without contact: displacements and dual solutions, as `ContactSystem`."""

    exact = True

    def __init__(
        self, problem: ContactProblem, solver: Solver, stages: Stages, objects: PetscObjects, free: FreeMotions | None
    ) -> None:
        self._supports, self._tolerance, self._free = problem.supports, solver.tolerance, free
        with stages("system"):
            self.solver = problem.linear_solver(solver, objects)
        with stages("setup"):
            if free is not None:
                self.solver.regularise()
            self.solver.set_up()

    def solve(self, load: FloatArray, u: FloatArray, tolerance: float) -> FloatArray:
        """The displacement [m] for a load [N], from a first guess [m], all (owned, 3).  Raises SolveError."""
        u = self._supports.tangential(self.solver.solve(Equations(load, projector=self._free), u, tolerance))
        return u if self._free is None else self._free.remaining(u)

    def dual(
        self, load: FloatArray, _: FloatArray | None, tolerance: float, z: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """As `ContactSystem.dual`, without rows."""
        load = self._supports.free_part(load)
        guess = np.zeros_like(load) if z is None else z
        return self.solve(load, guess, max(tolerance, self._tolerance)), np.zeros(0)


class ContactSystem:
    """K u + B^T f = L with `Springs` in the rows: displacements, forces, and dual solutions.

    A projection constrains rows that are rigid or stiffer than `ConstraintRows.capped_stiffness`, k_c; the latter yield
    in it.  The matrix has the springs of an earlier status, up to k_c (`MatrixPenalty`); rigid rows have k_c beside
    their constraint, which changes nothing but rounding.  Motions of interfaces that turn no normals are unknowns of
    the projection, and their given forces are spread over the rows, which have no k_c: a soft motion, as of the end of
    a slender bar, would have a natural norm of k_c against its own stiffness, and PCG stop too early.

    Collective.

    Args:
        load: (owned, 3), right-hand side without contact [N].
        contained: (n,), springs of the rows in the problem's matrix [N/m].
        objects: free the system, which owns the matrix.

    Attributes:
        solver: of K with the penalty in the matrix.
        jump: of the present rows.
        springs: of the last solve.
        movable: (n,), as of `Jump`.
        capped_stiffness: (n,), k_c [N/m].
        energy_norm, comm: as of the problem.
    """

    def __init__(
        self,
        problem: ContactProblem,
        load: FloatArray,
        jump: Jump,
        contained: FloatArray,
        options: SolveOptions,
        stages: Stages,
        objects: PetscObjects,
    ) -> None:
        self._load, self._stages, self._options = load, stages, options.solver
        self.exact = options.enforcement.method == "exact"
        self._supports, self.energy_norm, self.comm = problem.supports, problem.energy_norm, problem.matrix.comm
        self.movable, self.capped_stiffness = jump.movable, jump.rows.capped_stiffness
        if problem.coarse is not None:
            problem.coarse.couple(jump.matrix.distributed())
        self.solver = problem.linear_solver(options.solver, objects)
        self._take(jump)
        self._in_matrix = MatrixPenalty(self.solver, problem.coarse, jump, contained)
        self._slides = any_true(self.comm, jump.rows.role == Role.TANGENT)
        self._is_set_up = False
        self._energy = 0.0  # of the last solution, twice [J]

    def exchange_rows(self, rows: ConstraintRows) -> None:
        """Go on with rows of the same nodes with other directions and gaps."""
        self._take(Jump(rows, self._supports))

    def _take(self, jump: Jump) -> None:
        """Rows of a jump, and the constant motions of their interfaces."""
        self.jump, self._motions = jump, RowMotions.of(jump.rows, turning=False)
        motions = self._motions
        self._moving, self._given = motions.moving, motions.spread() if len(motions) else None
        self._projector = Projection(jump, motions.rates)

    def solve(self, springs: Springs, u: FloatArray, tolerance: float, anew: bool = False) -> FloatArray:
        """The displacement for springs in the rows, from a first guess, both (owned, 3) [m].

        Args:
            anew: the preconditioner is made for these springs alone.

        Raises:
            SolveError: as `LinearSolver.solve`, or as `Projection`.
        """
        # Normals change a few at a time in loose solves, tangents by hundreds (`studies.cost.friction`).
        renewed = self._slides or tolerance <= self._options.tolerance
        if anew or renewed and self._disturbs(springs) or not self._is_set_up or self.solver.is_slow:
            self._set_up(springs)
        with self._stages("system"):
            self.springs = springs = (
                springs if self._given is None else springs + Springs(0.0 * self._given, None, self._given)
            )
            self._shifted = self.jump if springs.shift is None else self.jump.shifted(springs.shift)
            force = 0.0 if springs.force is None else self.jump.transposed(springs.force)
            self._forced = self._load - force
            self._projection = self._projection_of(self._shifted)
            if not any_true(self.comm, np.append(self._forced != 0, springs.closed & (self._shifted.gap != 0))):
                u = np.zeros_like(u)  # the solution; PCG's tolerance is relative to its energy, 0
            u = self._projection.onto_closed(u)
        try:
            u = self._solved(u, tolerance)
        except SolveError:
            if not self._in_matrix.differs(self.jump, self._capped(springs)):
                raise
            # The preconditioner of another status may fail, as in slender bodies where 20 closed rows become 340.
            self._set_up(springs)
            u = self._solved(u, tolerance)
        self._is_set_up = not anew
        return u

    def _projection_of(self, jump: Jump) -> Projection:
        """Projection of the rows stiffer than k_c, for the last springs and another jump."""
        stiffness = self.springs.stiffness
        return self._projector.of(jump, stiffness > self.capped_stiffness, stiffness)

    def _solved(self, u: FloatArray, tolerance: float) -> FloatArray:
        """The displacement for the last springs, by the present preconditioner."""
        with self._stages("system"):
            stiffness, projector = self._in_operator(self.springs), self._projector_behind(self._projection)
            equations = self._in_matrix.equations(self._shifted, self._forced, stiffness, projector)
        with self._stages("solve"):
            u = self._solution(equations, u, tolerance)
            self._energy = self.energy_norm(u) ** 2
        return u

    def _projector_behind(self, projection: Projection) -> Projector:
        """The projection, which leaves out the free motions of the last springs."""
        return projection if self.springs.free is None else self.springs.free.behind(projection)

    def _solution(self, equations: Equations, u: FloatArray, tolerance: float) -> FloatArray:
        u = self._supports.tangential(self.solver.solve(equations, u, tolerance))
        return u if self.springs.free is None else self.springs.free.remaining(u)

    def _capped(self, springs: Springs) -> FloatArray:
        """(n,), springs in the matrix: up to k_c, 0 in rows that move [N/m]."""
        capped = np.minimum(springs.stiffness, self.capped_stiffness)
        return np.where(self._moving & np.isinf(springs.stiffness), 0.0, capped)

    def _in_operator(self, springs: Springs) -> FloatArray:
        """(n,), springs beside the projection, of rigid rows those of the matrix [N/m]."""
        return np.where(np.isinf(springs.stiffness), self._capped(springs), springs.stiffness)

    def _set_up(self, springs: Springs) -> None:
        """Build the preconditioner for springs in the rows."""
        with self._stages("setup"):
            self._in_matrix.replace(self.jump, self._capped(springs))
            if springs.free is not None:
                self.solver.regularise()
            self.solver.set_up()
        self._is_set_up = True

    def _disturbs(self, springs: Springs) -> bool:
        """True if rows without projection have another status in the preconditioner: outliers of the spectrum."""
        capped = self._capped(springs)
        free = springs.stiffness <= self.capped_stiffness
        return any_true(self.comm, ((self._in_matrix.stiffness > 0) != (capped > 0)) & free)

    def dual(
        self, load: FloatArray, penetration: FloatArray, tolerance: float, z: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Dual solution z (owned, 3) [m] of K z + B^T f = l, f = k (B z - d) on the last springs, and f (n,) [N].

        Args:
            load: (owned, 3), l, without constrained components [N].
            penetration: (n,), d [m].
            tolerance: of z, relative to its energy norm; not below that of the solver [-].
            z: first guess; None: 0.

        Raises:
            SolveError: as `LinearSolver.solve`, or as `Projection`.
        """
        jump, load = self.jump.with_gap(penetration), self._supports.free_part(load)
        projection = self._projection_of(jump)
        guess = projection.onto_closed(np.zeros_like(load) if z is None else z)
        projector = self._projector_behind(projection)
        equations = self._in_matrix.equations(jump, load, self._in_operator(self.springs), projector)
        z = self._solution(equations, guess, max(tolerance, self._options.tolerance))
        force = self._capped(self.springs) * jump.penetration(z) + self._projected_forces(jump, load, projection, z)
        return z, force

    def _projected_forces(self, jump: Jump, load: FloatArray, projection: Projection, u: FloatArray) -> FloatArray:
        """Forces (n,) [N] of projected rows beside their springs up to k_c, which balance the residual."""
        equations = self._in_matrix.equations(jump, load, self._capped(self.springs), projection)
        return projection.apply_transpose(self.solver.residual(equations, u))

    def forces(self, u: FloatArray) -> FloatArray:
        """Forces (n,) [N] of the rows for the last solution u (owned, 3) [m].  Raises SolveError as `Projection`."""
        springs = self.springs
        force = PenaltyTerm(self._shifted, self._capped(springs)).forces(u)
        force += self._projected_forces(self._shifted, self._forced, self._projection, u)
        return force if springs.force is None else force + springs.force

    def trial(self, u: FloatArray) -> FloatArray:
        """Forces (n,) of closed rows and tangents, k_c (B u - D) of open ones, for the last solution u (owned, 3) [m].

        Normals that remain open after the projection, because other constraints determine them, count as open.

        Raises:
            SolveError: as `Projection`; prescribed displacements force closed rows to penetrate.
        """
        springs, role = self.springs, self.jump.rows.role
        normal, tangent = role == Role.NORMAL, role == Role.TANGENT
        held = springs.closed & (~tangent | np.isinf(springs.stiffness))
        left = self._shifted.penetration(self._projector.of(self._shifted, held).onto_closed(u))
        if self._given is not None:
            left = left + self._motions.found(left) @ self._motions.rates
        force = self.forces(u)
        opens = self._projection.closed & normal & (left < -self._rounding(force, u))
        known = tangent | (springs.closed & ~opens)
        trial = np.where(known, force, PenaltyTerm(self.jump, self.capped_stiffness).forces(u))
        apart = np.where(held & ~tangent, np.where(normal, left, np.abs(left)), 0.0)
        self._check_apart(apart, self._rounding(trial, u))
        return trial

    def _check_apart(self, left: FloatArray, rounding: float) -> None:
        """Raises SolveError if the nearest displacement with B u = D leaves penetrations (n,) [m], and no gaps."""
        if self._largest(np.minimum(left, 0.0)) > rounding:
            return
        rows = self.jump.rows
        worst = int(left.argmax()) if len(left) else 0
        of_worst = (float(left[worst]), rows.position[worst].tolist()) if len(left) else (0.0, [])
        tied = bool((rows.role != Role.NORMAL)[worst : worst + 1].any())
        deepest, place, tied = max(self.comm.allgather((*of_worst, tied)))
        if deepest > rounding:
            at = f"at ({', '.join(f'{x:.4g}' for x in place)})"
            if tied:
                raise SolveError(
                    f"displacements prescribed on both surfaces of a tie, or around it, differ by {deepest:.3g}, {at}: "
                    "the tie cannot keep them together; leave one of them free"
                )
            raise SolveError(
                f"displacements prescribed on both surfaces of a contact, or around it, press them {deepest:.3g} "
                f"into each other, {at}: contact cannot keep them apart; leave one of them free"
            )

    def _rounding(self, trial: FloatArray, u: FloatArray) -> float:
        """Bound [m] of the rounding of gaps and penetrations of closed rows; the approach is energy over force."""
        normal = self.springs.closed & (self.jump.rows.role == Role.NORMAL)
        pressed = self.comm.allreduce(float(np.maximum(trial, 0.0)[normal].sum()))
        moved = self._largest(u)
        approach = min(moved, self._energy / pressed) if pressed > 0 else moved
        return max(_OF_APPROACH * approach, _OF_DISPLACEMENT * moved)

    def _largest(self, values: FloatArray) -> float:
        return float(self.comm.allreduce(float(np.abs(values).max(initial=0.0)), op=MPI.MAX))
