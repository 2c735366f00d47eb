"""The linear system of the closed pairs, and what is kept from one active set to the next."""

import numpy as np
from mpi4py import MPI

from fx_contact.contact.penalty_term import PenaltyTerm
from fx_contact.contact.projection import Projection
from fx_contact.linalg.conjugate_gradients import ConjugateGradients
from fx_contact.parallel.errors import SolveError

#: Overlap that conditions leave between vertices, relative to the approach, up to which it is rounding,
_OVERLAP = 1e-6
#: and relative to the largest displacement, where there is hardly an approach.
_MOVED = 1e-12
#: Tolerance of dual solutions: by what they say the same leaves are refined on any number of ranks.
_DUAL = 1e-6


class ContactSystem:
    """The linear system of closed pairs, whose set changes: displacements, forces, and dual solutions.

    Collective.

    Args:
        problem: ContactProblem, whose matrix has the penalty term of `active`; it is used up.
        base: (owned, 3) float64, right-hand side without contact [N].
        jump: Jump.
        active: (n,) bool, closed pairs.
        options: SolveOptions.
        environment: Environment.
    """

    def __init__(self, problem, base, jump, active, options, environment):
        self._base, self._jump, self._active, self._stages = base, jump, active, environment.stages
        self._solver, self._enforcement = options.solver, options.enforcement
        self._energy_norm = problem.energy_norm
        rows = jump.rows
        self._comm = rows.prolongation.comm
        self._nearest = Projection(jump)
        exact = self._enforcement.method == "exact"
        self._holdable = np.ones_like(active) if exact else rows.stiffness > rows.bounded_stiffness
        self._bounded, self._term, self._held = self._enforced(jump)
        self._forces = np.zeros(len(active))  # of the augmented Lagrangian
        self._known, self._is_set_up = active, False  # the active set in the matrix
        self._cg = ConjugateGradients(problem.matrix, self._solver, problem.energy_norm, environment.objects)

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
        """The displacement of some closed pairs.

        Args:
            active: (n,) bool, closed pairs.
            u: (owned, 3) float64, first guess [m].
            tolerance: of the linear solver [-].

        Returns:
            (owned, 3) float64 [m].
        """
        late = tolerance <= self._solver.tolerance and self._disturbs(active)
        if not self._is_set_up or late or self._cg.stops_paying():
            with self._stages("setup"):
                self._bounded.change(self._cg.matrix, self._known, active)
                self._cg.set_up()
            self._known, self._is_set_up = active, True
        with self._stages("system"):
            self._active, self._forces = active, np.where(active, self._forces, 0.0)
            right_hand_side = self._system(self._term)
            if not self._any(self._base) and not self._any(active & (self._jump.gap != 0)):
                # At rest; from elsewhere PCG would come close, but not by the energy of what is left.
                u = np.zeros_like(u)
            self._nearest.close(active)
            if self._held is not None:
                self._held.close(active & self._holdable)
                u = self._held.onto_closed(u)
        with self._stages("solve"):
            return self._cg.solve(right_hand_side, u, tolerance, self._held)

    def _enforced(self, jump):
        """The springs in the matrix, those of the enforcement, and the projection that holds pairs, or None."""
        rows = jump.rows
        bounded = PenaltyTerm(jump, rows.bounded_stiffness)
        if self._enforcement.method == "exact":
            return bounded, bounded, Projection(jump)
        held = Projection(jump, rows.stiffness) if self._any(self._holdable) else None
        return bounded, PenaltyTerm(jump), held

    def dual(self, overlap, force):
        """How the bodies answer overlaps of closed pairs, and forces, where nothing else moves or loads them.

        Collective.  It is the dual solution of the forces that the pairs have, weighted by the overlaps, or of the
        overlaps, weighted by the forces.  `solve` must not be called any more.

        Args:
            overlap: (n,) float64, of the closed pairs [m].
            force: (n,) float64, that presses the vertices of each pair together [N].

        Returns:
            (owned, 3) float64 [m].
        """
        bounded, term, held = self._enforced(self._jump.with_gap(overlap))
        self._cg.correct(term.difference(self._active, bounded, self._known))
        right_hand_side = bounded.right_hand_side(self._known, -force)
        u = np.zeros_like(right_hand_side)
        if held is not None:
            held.close(self._active & self._holdable)
            u = held.onto_closed(u)
        return self._cg.solve(right_hand_side, u, max(_DUAL, self._solver.tolerance), held)

    def _system(self, term):
        """Let the operator have a penalty term of the closed pairs; the right-hand side that belongs to it."""
        self._cg.correct(term.difference(self._active, self._bounded, self._known))
        return self._base + self._bounded.right_hand_side(self._known, self._forces)

    def check_apart(self, trial, u):
        """See that conditions do not press closed pairs into each other: no force could keep their vertices apart.

        Collective.  They do where the nearest displacement that closes the pairs leaves overlaps, and no gaps: the
        jumps of such pairs, weighted by their overlaps, add up to one that conditions alone decide.  Beside a gap that
        is not known yet: the pair that has it will open.

        Args:
            trial: (n,) float64, as from `trial` [N].
            u: (owned, 3) float64, the last solution [m].

        Raises:
            SolveError: they do, by more than rounding.
        """
        rounding = self._rounding(trial, u)
        rows, u = self._jump.rows, self._nearest.onto_closed(u)
        overlap = np.where(self._active, rows.penetration(u), 0.0)
        if self._largest(np.minimum(overlap, 0.0)) > rounding:
            return
        worst = int(overlap.argmax()) if len(overlap) else 0
        mine = (float(overlap[worst]), rows.position[worst].tolist()) if len(overlap) else (0.0, [])
        deepest, place = max(self._comm.allgather(mine))
        if deepest > rounding:
            raise SolveError(
                f"displacements prescribed on both surfaces of a contact, or around it, press them {deepest:.3g} m "
                f"into each other, at ({', '.join(f'{x:.4g}' for x in place)}): contact cannot keep them apart; leave "
                "one of them free"
            )

    def _disturbs(self, active):
        """Whether an active set differs from that of the preconditioner by other pairs than such as are held now.

        Each is an outlier of the spectrum that costs some iterations, and many soon more than a new set-up.  In the
        norm of a preconditioner that has a stiff pair as closed, a penetration that nothing resists any more looks
        small.  So the last solve allows none.
        """
        return self._any((self._known != active) & ~(active & self._holdable))

    def trial(self, u):
        """Force of closed pairs, and of open ones the force that a penalty would exert.

        That of held pairs is what keeps the forces on their vertices in balance, whatever rounding does to their
        penetration.  Held pairs whose gap others that share their vertex leave open, however near, count as open.

        Args:
            u: (owned, 3) float64, the last solution [m].

        Returns:
            (n,) float64, compression positive [N].
        """
        trial = self._forces + self._bounded.force(u)
        if self._held is None:
            return trial
        residual = self._cg.residual(self._system(self._bounded), u)
        held = trial + self._held.apply_transpose(residual)
        penetration = self._jump.rows.penetration(self._nearest.onto_closed(u))
        closed = self._held.closed & (penetration >= -self._rounding(held, u))
        return np.where(closed, held, trial)

    def _rounding(self, trial, u):
        """Gaps and overlaps of closed pairs up to which they are rounding: float [m]."""
        return max(_OVERLAP * self._approach(self._pressing(trial), u), _MOVED * self._largest(u))

    def _any(self, values):
        """Whether one of the values on any rank is not 0."""
        return self._comm.allreduce(bool(values.any()), op=MPI.LOR)

    def _largest(self, values):
        """The largest absolute value on all ranks: float."""
        return self._comm.allreduce(float(np.abs(values).max(initial=0.0)), op=MPI.MAX)

    def augment(self, trial, u):
        """Add the penalty's forces to those of the augmented Lagrangian, if they still leave a penetration.

        Args:
            trial: (n,) float64, as from `trial` [N].
            u: (owned, 3) float64, the last solution [m].

        Returns:
            bool, whether that has changed the system.
        """
        if self._enforcement.method != "augmented-lagrangian":
            return False
        rows = self._jump.rows
        penetration = rows.penetration(u)
        beyond_noise = np.abs(penetration) * np.sqrt(rows.stiffness) > self.noise
        force = self._pressing(trial)
        count = self._comm.allreduce(int(rows.contact.max(initial=-1)) + 1, op=MPI.MAX)
        _, approach = rows.pressing(force, rows.contact, count)
        approach = np.minimum(approach, self._approach(force, u))[rows.contact]
        penetrating = self._active & self._jump.movable & beyond_noise
        if not self._any(penetrating & (np.abs(penetration) > self._enforcement.gap_tolerance * approach)):
            return False
        self._forces = force
        return True

    def _pressing(self, trial):
        """Forces of the closed pairs that press: (n,) float64 [N]."""
        return np.where(self._active, np.maximum(trial, 0.0), 0.0)

    def _approach(self, force, u):
        """About how far bodies approach each other: their energy over the force, for they may come from afar [m]."""
        pressed = self._comm.allreduce(float(force.sum()))
        moved = self._largest(u)
        return min(moved, self._energy_norm(u) ** 2 / pressed) if pressed > 0 else moved
