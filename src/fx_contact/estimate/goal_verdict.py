"""Whether the errors of forces and gaps are small enough, and which cells to refine where they are not."""

import numpy as np

from fx_contact.estimate.marking import for_goal


class Verdict:
    """What the goals of one contact pair say of its error, and which cells they need; its force comes first.

    Collective on comm.

    Args:
        cells: number of this rank's cells.
        comm: MPI communicator.
        force: of the contact pair's modelled part; 0: it has none [N].
        bound: of the relative error of that force, without a dual solution [-].
        allowed: relative error that the force may have [-].
        control: ErrorControl.

    Attributes:
        error: of the force, with what places that may close would add, relative to it; without a force the largest
            error of a gap, relative to that; None: nothing is known [-].
        refine: (cells,) int8, how often to refine each cell.
    """

    def __init__(self, cells, comm, force, bound, allowed, control):
        self._comm, self._force, self._allowed, self._control = comm, force, allowed, control
        self.error, self.refine = bound if force else None, np.zeros(cells, dtype=np.int8)

    def judge_force(self, goal):
        """Let the dual solution of the force say its error, in place of the bound."""
        self.error = goal.total / goal.value
        self._mark(goal, self._allowed * goal.value)

    def judge_gap(self, goal, open_enough):
        """See what the error of a gap lets the force be, or whether there is one.

        Args:
            goal: Goal of the gap.
            open_enough: error that it may have so that it is a gap [m].
        """
        if not self._force:
            error = goal.total / goal.value if goal.value else float(goal.total > 0)
            self.error = max(self.error or 0.0, error)
        elif goal.compliance:
            self.error += max(goal.total - goal.value, 0.0) / goal.compliance / self._force
        self._mark(goal, max(open_enough, self._allowed * self._force * goal.compliance))

    def _mark(self, goal, most):
        """Mark cells for a goal whose error is more than that, or first for a dual solution that tells nothing."""
        dual = goal.dual
        blind = self._control.dual_limit
        if dual.relative > blind:
            self.error = max(self.error, 1.0)
            refine = for_goal(dual.error**2, (blind * dual.energy_norm) ** 2, self._control, self._comm)
        elif goal.total > most:
            refine = for_goal(goal.error, most, self._control, self._comm)
        else:
            return
        np.maximum(self.refine, refine, out=self.refine)


def allowed_errors(forces, tolerance, effectivity):
    """Relative errors that forces of contact pairs may have: e of what each should be, or e^2 of the largest.

    Local.

    Args:
        forces: (npairs,) float64, or a list, `pair_forces` of a record [N].
        tolerance: prescribed accuracy e [-].
        effectivity: the part of the error that the estimate sees [-].

    Returns:
        (npairs,) float64, relative to the forces that they have [-].
    """
    forces = np.abs(forces)
    light = np.divide(forces.max(initial=0.0), forces, out=np.full(len(forces), np.inf), where=forces > 0)
    allowed = np.maximum(tolerance, tolerance**2 * light)
    return effectivity / (1 + 1 / allowed)
