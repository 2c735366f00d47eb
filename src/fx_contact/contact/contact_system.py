"""The linear system of an active set, whose preconditioner outlives changes of the set."""

import numpy as np
from mpi4py import MPI

from fx_contact.contact.contact_problem import ContactProblem, SolveOptions
from fx_contact.contact.jump import Jump
from fx_contact.contact.penalty_term import PenaltyTerm
from fx_contact.contact.projection import Projection
from fx_contact.linalg.operator import Equations, Sum
from fx_contact.linalg.petsc_objects import PetscObjects
from fx_contact.linalg.solver_options import Solver
from fx_contact.parallel.arrays import BoolArray, FloatArray
from fx_contact.parallel.errors import SolveError
from fx_contact.parallel.timing import Stages

#: Errors of penetrations and gaps of closed rows: of the linear solver, relative to the approach (100 times its
#: default tolerance); by rounding, relative to the largest displacement (1e4 times that of a double).
_OF_APPROACH, _OF_DISPLACEMENT = 1e-6, 1e-12


class LinearSystem:
    """K u = L without contact: displacements and dual solutions, as `ContactSystem`."""

    exact = True

    def __init__(self, problem: ContactProblem, options: Solver, stages: Stages, objects: PetscObjects) -> None:
        self._supports, self._tolerance = problem.supports, options.tolerance
        with stages("system"):
            self.solver = problem.linear_solver(options, objects)
        with stages("setup"):
            self.solver.set_up()

    def solve(self, load: FloatArray, u: FloatArray, tolerance: float) -> FloatArray:
        """The displacement [m] for a load [N], from a first guess [m], all (owned, 3).  Raises SolveError."""
        return self._supports.tangential(self.solver.solve(Equations(load), u, tolerance))

    def dual(
        self, load: FloatArray, _: FloatArray | None, tolerance: float, z: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """As `ContactSystem.dual`, without rows."""
        load = self._supports.free_part(load)
        guess = np.zeros_like(load) if z is None else z
        return self.solve(load, guess, max(tolerance, self._tolerance)), np.zeros(0)


class ContactSystem:
    """K u + B^T f = L of the closed rows: displacements, forces, and dual solutions.

    In exact contact a projection constrains all closed rows, else those stiffer than the factor `CAP`.  The matrix has
    the capped penalty term of an active set; the difference to the operator is applied matrix-free.

    Collective.

    Args:
        problem: its matrix has the capped penalty term of `active`.
        load: (owned, 3), right-hand side without contact [N].
        active: (n,), closed rows.
        objects: free the system, which owns the matrix.

    Attributes:
        solver: of K with the capped penalty term.
        exact: closed rows do not yield.
        movable: (n,), as of `Jump`.
        equality: (n,), as of the rows.
        capped_stiffness, stiffness: (n,), k of closed rows in the preconditioner and of their enforcement [N/m].
        energy_norm, comm: as of the problem.
    """

    def __init__(
        self,
        problem: ContactProblem,
        load: FloatArray,
        jump: Jump,
        active: BoolArray,
        options: SolveOptions,
        stages: Stages,
        objects: PetscObjects,
    ) -> None:
        self._load, self._jump, self._stages, self._rows = load, jump, stages, jump.rows
        self._supports, self.energy_norm = problem.supports, problem.energy_norm
        self._options, self.comm, self._coarse = options.solver, problem.matrix.comm, problem.coarse
        self.capped_stiffness, self.movable = self._rows.capped_stiffness, jump.movable
        self.equality = self._rows.equality
        self.exact = options.enforcement.method == "exact"
        self.stiffness = self.capped_stiffness if self.exact else self._rows.stiffness
        self._projected = np.ones_like(active) if self.exact else self.stiffness > self.capped_stiffness
        self._projection = self._projection_of(jump)
        self._nearest = Projection(jump)  # of all closed rows, however they are enforced
        if self._coarse is not None:
            self._coarse.couple(jump.matrix.distributed())
        self.solver = problem.linear_solver(self._options, objects)
        self._active = active  # of the last solve
        self._in_matrix, self._jump_in_matrix = active * self.capped_stiffness, jump  # penalty term in the matrix
        self._is_set_up = False
        self._energy = 0.0  # of the last solution, twice [J]

    def exchange_rows(self, jump: Jump) -> None:
        """Go on with rows of the same nodes with other normals and gaps; the preconditioner keeps the former ones."""
        self._jump, self._rows = jump, jump.rows
        self._projection, self._nearest = self._projection_of(jump), Projection(jump)

    def _projection_of(self, jump: Jump) -> Projection | None:
        """Projection of the projected rows, if any."""
        if self.exact:
            return Projection(jump)
        return Projection(jump, self.stiffness) if self._any(self._projected) else None

    def _equations(
        self, jump: Jump, load: FloatArray, stiffness: FloatArray, projection: Projection | None
    ) -> Equations:
        """Equations of the active set with a penalty of the closed rows."""
        if self._jump_in_matrix is not self._jump:
            former = self._jump_in_matrix.with_gap(np.zeros_like(jump.gap))
            terms = PenaltyTerm(jump, self._active * stiffness), PenaltyTerm(former, -self._in_matrix)
            return Equations(load, Sum(terms), projection)
        difference = self._active * stiffness - self._in_matrix
        term = PenaltyTerm(jump, difference) if self._any(difference) else None
        return Equations(load + PenaltyTerm(jump, self._in_matrix).load(), term, projection)

    def solve(self, active: BoolArray, u: FloatArray, tolerance: float) -> FloatArray:
        """The displacement for closed rows (n,), from a first guess, both (owned, 3) [m].  Raises SolveError."""
        late = tolerance <= self._options.tolerance and self._disturbs(active)
        if not self._is_set_up or late or self.solver.is_slow:
            self._set_up(active * self.capped_stiffness)
        with self._stages("system"):
            self._active = active
            if not self._any(self._load) and not self._any(active & (self._jump.gap != 0)):
                u = np.zeros_like(u)  # the solution; PCG's tolerance is relative to its energy, 0
            self._nearest.close(active)
            if self._projection is not None:
                self._projection.close(active & self._projected)
                u = self._projection.onto_closed(u)
        try:
            return self._solved(u, tolerance)
        except SolveError:
            others = self._jump_in_matrix is not self._jump
            if not (others or self._any(self._in_matrix != active * self.capped_stiffness)):
                raise
        # The preconditioner of another active set may fail, as in slender bodies where 20 closed rows become 340.
        self._set_up(active * self.capped_stiffness)
        return self._solved(u, tolerance)

    def _solved(self, u: FloatArray, tolerance: float) -> FloatArray:
        """The displacement for the active set, by the present preconditioner."""
        with self._stages("system"):
            equations = self._equations(self._jump, self._load, self.stiffness, self._projection)
        with self._stages("solve"):
            u = self._supports.tangential(self.solver.solve(equations, u, tolerance))
            self._energy = self.energy_norm(u) ** 2
        return u

    def solve_springs(
        self, stiffness: FloatArray, shift: FloatArray, u: FloatArray, tolerance: float
    ) -> tuple[FloatArray, FloatArray]:
        """Displacement (owned, 3) [m] and forces f = k (B u - D) (n,) [N] of springs in all rows, from a first guess.

        Args:
            stiffness: (n,), k > 0 [N/m].
            shift: (n,), D less the gap of the rows [m].

        Raises:
            SolveError: as `LinearSolver.solve`, or as `Projection`.
        """
        jump, capped = self._jump.shifted(shift), np.minimum(stiffness, self.capped_stiffness)
        self._set_up(capped)
        projection, term = Projection(jump, stiffness), PenaltyTerm(jump, capped)
        projection.close(stiffness > capped)
        load = self._load + term.load()
        equations = Equations(load, PenaltyTerm(jump, stiffness - capped), projection)
        with self._stages("solve"):
            u = self._supports.tangential(self.solver.solve(equations, projection.onto_closed(u), tolerance))
        residual = self.solver.residual(Equations(load, None, projection), u)
        self._is_set_up = False
        return u, term.forces(u) + projection.apply_transpose(residual)

    def _set_up(self, stiffness: FloatArray) -> None:
        """Build the preconditioner with a penalty term (n,) of all rows [N/m]."""
        with self._stages("setup"):
            if self._jump_in_matrix is not self._jump:
                PenaltyTerm(self._jump_in_matrix, -self._in_matrix).add_to(self.solver.matrix)
                self._in_matrix, self._jump_in_matrix = np.zeros_like(stiffness), self._jump
                if self._coarse is not None:
                    self._coarse.set_penalty(self._in_matrix)
                    self._coarse.couple(self._jump.matrix.distributed())
            PenaltyTerm(self._jump, stiffness - self._in_matrix).add_to(self.solver.matrix)
            if self._coarse is not None:
                self._coarse.set_penalty(stiffness)
            self.solver.set_up()
        self._in_matrix, self._is_set_up = stiffness, True

    def _disturbs(self, active: BoolArray) -> bool:
        """True if rows without projection have another status in the preconditioner: outliers of the spectrum."""
        return self._any((self._in_matrix != active * self.capped_stiffness) & ~(active & self._projected))

    def dual(
        self, load: FloatArray, penetration: FloatArray, tolerance: float, z: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Dual solution z (owned, 3) [m] of K z + B^T f = l, B z = d on the closed rows, and their forces f (n,) [N].

        Args:
            load: (owned, 3), l, without constrained components [N].
            penetration: (n,), d [m].
            tolerance: of z, relative to its energy norm; not below that of the solver [-].
            z: first guess; None: 0.

        Raises:
            SolveError: as `LinearSolver.solve`, or as `Projection`.
        """
        jump, load = self._jump.with_gap(penetration), self._supports.free_part(load)
        guess = np.zeros_like(load) if z is None else z
        projection = self._projection_of(jump)
        if projection is not None:
            projection.close(self._active & self._projected)
            guess = projection.onto_closed(guess)
        equations = self._equations(jump, load, self.stiffness, projection)
        z = self.solver.solve(equations, guess, max(tolerance, self._options.tolerance))
        force = PenaltyTerm(jump, self.capped_stiffness).forces(z)
        if projection is not None:
            force += self._projected_forces(jump, load, projection, z)
        return self._supports.tangential(z), self._active * force

    def _projected_forces(self, jump: Jump, load: FloatArray, projection: Projection, u: FloatArray) -> FloatArray:
        """Forces (n,) [N] of projected rows beside the capped penalty, which balance the residual."""
        residual = self.solver.residual(self._equations(jump, load, self.capped_stiffness, projection), u)
        return projection.apply_transpose(residual)

    def trial(self, u: FloatArray) -> FloatArray:
        """Forces (n,) of closed rows, and k (B u - D) of open ones, for the last solution u (owned, 3) [m].

        Projected rows that other rows keep from closing count as open, except those of ties.  Raises SolveError as
        `Projection`.
        """
        force = PenaltyTerm(self._jump, self.capped_stiffness).forces(u)
        if self._projection is None:
            return force
        projected = force + self._projected_forces(self._jump, self._load, self._projection, u)
        penetration = self._rows.penetration(self._nearest.onto_closed(u))
        closed = self._projection.closed & (self.equality | (penetration >= -self._rounding(projected, u)))
        return np.where(closed, projected, force)

    def check_apart(self, trial: FloatArray, u: FloatArray) -> None:
        """Check that prescribed displacements do not force closed rows to penetrate, by `trial` forces of a solution u.

        Raises:
            SolveError: the nearest displacement with B u = D leaves penetrations, or parts of ties, and no gaps of rows
                that may open.
        """
        rounding = self._rounding(trial, u)
        left = np.where(self._active, self._rows.penetration(self._nearest.onto_closed(u)), 0.0)
        left = np.where(self.equality, np.abs(left), left)
        if self._largest(np.minimum(left, 0.0)) > rounding:
            return
        worst = int(left.argmax()) if len(left) else 0
        of_worst = (float(left[worst]), self._rows.position[worst].tolist()) if len(left) else (0.0, [])
        deepest, place, tied = max(self.comm.allgather((*of_worst, bool(self.equality[worst : worst + 1].any()))))
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
        pressed = self.comm.allreduce(float(np.maximum(trial, 0.0)[self._active & ~self.equality].sum()))
        moved = self._largest(u)
        approach = min(moved, self._energy / pressed) if pressed > 0 else moved
        return max(_OF_APPROACH * approach, _OF_DISPLACEMENT * moved)

    def _any(self, values: BoolArray | FloatArray) -> bool:
        return bool(self.comm.allreduce(bool(values.any()), op=MPI.LOR))

    def _largest(self, values: FloatArray) -> float:
        return float(self.comm.allreduce(float(np.abs(values).max(initial=0.0)), op=MPI.MAX))
