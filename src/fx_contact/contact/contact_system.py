"""The linear system of the closed rows, and what is kept from one active set to the next."""

import numpy as np
from mpi4py import MPI

from fx_contact.contact.penalty_term import PenaltyTerm
from fx_contact.contact.projection import Projection
from fx_contact.parallel.errors import SolveError

#: Penetrations and gaps of closed rows up to this part of the approach are errors of the linear solver: a hundred times
#: its default tolerance,
_OF_APPROACH = 1e-6
#: or up to this part of the largest displacement, rounding: 1e4 times that of a double.
_OF_DISPLACEMENT = 1e-12
#: Relative tolerance of dual solutions.  They steer refinement, which is to be the same on any number of ranks.
_DUAL = 1e-6


def dual_tolerance(solver):
    """Relative tolerance of dual solutions with a Solver [-].  Local."""
    return max(_DUAL, solver.tolerance)


class LinearSystem:
    """K u = L without contact, and its dual solutions, as `ContactSystem` has them.

    Collective.

    Args:
        cg: ConjugateGradients, set up.
        supports: Supports.
        solver: Solver.
    """

    def __init__(self, cg, supports, solver):
        self._cg, self._supports, self._solver = cg, supports, solver

    @property
    def iterations(self):
        """As `ContactSystem.iterations`."""
        return self._cg.iterations

    @property
    def preconditioner(self):
        """As `ContactSystem.preconditioner`."""
        return self._cg.preconditioner

    @property
    def noise(self):
        """As `ContactSystem.noise`."""
        return self._cg.energy_error

    def solve(self, base, u, tolerance):
        """The displacement (owned, 3) float64 [m] for forces (owned, 3) float64 [N], from a first guess."""
        return self._supports.along_planes(self._cg.solve(base, u, tolerance))

    def dual(self, load, _=None):
        """As `ContactSystem.dual`, without rows."""
        load = self._supports.free_part(load)
        return self.solve(load, np.zeros_like(load), dual_tolerance(self._solver)), np.zeros(0)


class ContactSystem:
    """K u + B^T f = L of closed rows, whose set changes: displacements, forces, and dual solutions.

    Closed rows are enforced in two ways.  A projection constrains the `_projected` ones: all in exact contact, else
    those with stiffer springs than `HELD`.  The matrix has springs of bounded stiffness for all closed rows, so that
    its preconditioner knows of contact; what the enforcement has more or less is a correction beside the matrix.

    Collective.

    Args:
        problem: ContactProblem, whose matrix has the bounded springs of `active`; it is used up.
        base: (owned, 3) float64, right-hand side without contact [N].
        jump: Jump.
        active: (n,) bool, closed rows.
        options: SolveOptions.
        environment: Environment.
    """

    def __init__(self, problem, base, jump, active, options, environment):
        self._base, self._jump, self._stages = base, jump, environment.stages
        self._supports = problem.supports
        self._solver, self._enforcement = options.solver, options.enforcement
        self._rows, self._comm, self._energy_norm = jump.rows, problem.matrix.comm, problem.energy_norm
        exact = self._enforcement.method == "exact"
        self._projected = np.ones_like(active) if exact else self._rows.stiffness > self._rows.bounded_stiffness
        self._bounded, self._term, self._projection = self._enforced(jump)
        self._nearest = Projection(jump)  # of all closed rows, however they are enforced
        objects, self._coarse = environment.objects, problem.coarse
        self._cg = problem.linear_solver(self._solver, objects)
        if self._coarse is not None:
            self._coarse.couple(jump.matrix.distributed())
        # What changes: the closed rows, their forces in the augmented Lagrangian, and the set in the matrix.
        self._active, self._forces = active, np.zeros(len(active))
        self._known, self._is_set_up = active, False

    def _enforced(self, jump):
        """Springs in the matrix, springs of the enforcement, and the Projection of projected rows or None."""
        bounded = PenaltyTerm(jump, self._rows.bounded_stiffness)
        if self._enforcement.method == "exact":
            return bounded, bounded, Projection(jump)
        projection = Projection(jump, self._rows.stiffness) if self._any(self._projected) else None
        return bounded, PenaltyTerm(jump), projection

    @property
    def iterations(self):
        """list of int, Krylov iterations of each solve."""
        return self._cg.iterations

    @property
    def preconditioner(self):
        """Name of the present preconditioner."""
        return self._cg.preconditioner

    @property
    def noise(self):
        """Error of the last solution in the norm of the operator [J^(1/2)]."""
        return self._cg.energy_error

    def solve(self, active, u, tolerance):
        """The displacement for some closed rows.

        Collective.

        Args:
            active: (n,) bool, closed rows.
            u: (owned, 3) float64, first guess [m].
            tolerance: of the linear solver [-].

        Returns:
            (owned, 3) float64 [m].
        """
        late = tolerance <= self._solver.tolerance and self._disturbs(active)
        if not self._is_set_up or late or self._cg.stops_paying():
            with self._stages("setup"):
                self._bounded.change(self._cg.matrix, self._known, active)
                if self._coarse is not None:
                    self._coarse.stiffen(active * self._rows.bounded_stiffness)
                self._cg.set_up()
            self._known, self._is_set_up = active, True
        with self._stages("system"):
            self._active, self._forces = active, np.where(active, self._forces, 0.0)
            right_hand_side = self._correct(self._term)
            if not self._any(self._base) and not self._any(active & (self._jump.gap != 0)):
                u = np.zeros_like(u)  # the solution; PCG's tolerance is relative to its energy, 0
            self._nearest.close(active)
            if self._projection is not None:
                self._projection.close(active & self._projected)
                u = self._projection.onto_closed(u)
        with self._stages("solve"):
            return self._supports.along_planes(self._cg.solve(right_hand_side, u, tolerance, self._projection))

    def dual(self, load, penetration):
        """The dual solution z of K z + B^T f = l, B z = d on the closed rows, with nothing prescribed.

        Collective.  With d = 1 on the closed rows of a contact pair it is the adjoint of their force, with l = B^T g
        and forces g on open rows that of the gaps there.

        Args:
            load: (owned, 3) float64, l; what it has in held directions does not matter [N].
            penetration: (n,) float64, d [m].

        Returns:
            (owned, 3) float64 z [m], and (n,) float64, the forces f of closed rows [N].
        """
        bounded, term, projection = self._enforced(self._jump.with_gap(penetration))
        right_hand_side = bounded.right_hand_side(self._known) + self._supports.free_part(load)
        u = np.zeros_like(right_hand_side)
        if projection is not None:
            projection.close(self._active & self._projected)
            u = projection.onto_closed(u)
        self._cg.correct(term.difference(self._active, bounded, self._known))
        try:
            z = self._cg.solve(right_hand_side, u, dual_tolerance(self._solver), projection)
            if projection is None:
                force = term.force(z)
            else:
                self._cg.correct(bounded.difference(self._active, bounded, self._known))
                residual = self._cg.residual(right_hand_side, z)
                force = bounded.force(z) + projection.apply_transpose(residual)
            return self._supports.along_planes(z), self._active * force
        finally:
            self._correct(self._term)

    def _correct(self, term):
        """Let the operator have a penalty term of the closed rows; the right-hand side that belongs to the matrix."""
        self._cg.correct(term.difference(self._active, self._bounded, self._known))
        return self._base + self._bounded.right_hand_side(self._known, self._forces)

    def _disturbs(self, active):
        """Whether rows changed since the set-up of the preconditioner that are not projected now.

        Each is an outlier of the spectrum and costs iterations.  A spring that only the preconditioner has makes the
        penetration there look small in its norm, so the last solve allows none.
        """
        return self._any((self._known != active) & ~(active & self._projected))

    def trial(self, u):
        """Force of closed rows, and of open ones the force k (B u - D) that a penalty would exert.

        Collective.  The force of projected rows balances the residual, so that rounding of B u - D does not matter.
        Those whose gap no displacement closes, because others at their nodes hold it open, count as open.

        Args:
            u: (owned, 3) float64, the last solution [m].

        Returns:
            (n,) float64, compression positive [N].
        """
        trial = self._forces + self._bounded.force(u)
        if self._projection is None:
            return trial
        residual = self._cg.residual(self._correct(self._bounded), u)
        projected = trial + self._projection.apply_transpose(residual)
        penetration = self._rows.penetration(self._nearest.onto_closed(u))
        closed = self._projection.closed & (penetration >= -self._rounding(projected, u))
        return np.where(closed, projected, trial)

    def check_apart(self, trial, u):
        """See that conditions do not press closed rows into each other: no force could keep the bodies apart.

        Collective.  They do if the nearest displacement with B u = D leaves penetrations and no gaps.  A gap may be
        that of a row that will open, and is waited for.

        Args:
            trial: (n,) float64, as from `trial` [N].
            u: (owned, 3) float64, the last solution [m].

        Raises:
            SolveError: they do, by more than rounding.
        """
        rounding = self._rounding(trial, u)
        left = np.where(self._active, self._rows.penetration(self._nearest.onto_closed(u)), 0.0)
        if self._largest(np.minimum(left, 0.0)) > rounding:
            return
        worst = int(left.argmax()) if len(left) else 0
        mine = (float(left[worst]), self._rows.position[worst].tolist()) if len(left) else (0.0, [])
        deepest, place = max(self._comm.allgather(mine))
        if deepest > rounding:
            raise SolveError(
                f"displacements prescribed on both surfaces of a contact, or around it, press them {deepest:.3g} "
                f"into each other, at ({', '.join(f'{x:.4g}' for x in place)}): contact cannot keep them apart; leave "
                "one of them free"
            )

    def augment(self, trial, u):
        """Add the forces of the penalty to those of the augmented Lagrangian, where they leave too much penetration.

        Collective.

        Args:
            trial: (n,) float64, as from `trial` [N].
            u: (owned, 3) float64, the last solution [m].

        Returns:
            bool, whether that has changed the system.
        """
        if self._enforcement.method != "augmented-lagrangian":
            return False
        rows, force = self._rows, self._pressing(trial)
        left = np.abs(rows.penetration(u))
        count = self._comm.allreduce(int(rows.contact.max(initial=-1)) + 1, op=MPI.MAX)
        _, approach = rows.pressing(force, rows.contact, count)
        approach = np.minimum(approach, self._approach(force, u))[rows.contact]
        beyond_noise = left * np.sqrt(rows.stiffness) > self.noise
        wrong = beyond_noise & (left > self._enforcement.gap_tolerance * approach)
        if not self._any(wrong & self._active & self._jump.movable):
            return False
        self._forces = force
        return True

    def _pressing(self, trial):
        """Forces of the closed rows that press: (n,) float64 [N]."""
        return np.where(self._active, np.maximum(trial, 0.0), 0.0)

    def _approach(self, force, u):
        """Energy over force, but no more than the largest displacement: how far bodies approach, about [m]."""
        pressed, moved = self._comm.allreduce(float(force.sum())), self._largest(u)
        return min(moved, self._energy_norm(u) ** 2 / pressed) if pressed > 0 else moved

    def _rounding(self, trial, u):
        """Gaps and penetrations of closed rows up to which they are rounding: float [m]."""
        approach = self._approach(self._pressing(trial), u)
        return max(_OF_APPROACH * approach, _OF_DISPLACEMENT * self._largest(u))

    def _any(self, values):
        """Whether one of the values on any rank is not 0."""
        return self._comm.allreduce(bool(values.any()), op=MPI.LOR)

    def _largest(self, values):
        """The largest absolute value on all ranks: float."""
        return self._comm.allreduce(float(np.abs(values).max(initial=0.0)), op=MPI.MAX)
