"""Whether the errors of forces and gaps are small enough, and which cells to refine where they are not."""

import numpy as np
from mpi4py import MPI

#: The error that the mean of a gap may have so that it is one, relative to it: the least is a half of the mean.
OPEN = 0.25
#: A dual solution whose own relative error seems larger tells nothing: 0.69 and 0.70 were seen where thin cells lock in
#: bending, and 0.59 where a single node is pressed.
BLIND = 0.65
#: The part of the allowed error that refinement aims at, and that which cells that are not refined keep at most.
_AIM, _KEPT = 0.8, 0.25
#: Errors of a child and of all eight, relative to their parent's, where both solutions are smooth.
_CHILD, _CHILDREN = 1 / 32, 1 / 4
#: Thresholds between which marking chooses, down to so much of the largest error.
_THRESHOLDS, _LEAST = 1024, 1e-12


class Verdict:
    """What the goals of one contact pair say of its error, and which cells they need; its force comes first.

    Collective on comm.

    Args:
        cells: number of this rank's cells.
        comm: MPI communicator.
        force: of the contact pair's modelled part; 0: it has none [N].
        bound: of the relative error of that force, without a dual solution [-].
        allowed: relative error that the force may have [-].

    Attributes:
        error: of the force, with what places that may close would add, relative to it; without a force the largest
            error of a gap, relative to that; None: nothing is known [-].
        refine: (cells,) int8, how often to refine each cell.
    """

    def __init__(self, cells, comm, force, bound, allowed):
        self._comm, self._force, self._allowed = comm, force, allowed
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
        if dual.relative > BLIND:
            self.error = max(self.error, 1.0)
            refine = marked(dual.error**2, (BLIND * dual.energy_norm) ** 2, self._comm)
        elif goal.total > most:
            refine = marked(goal.error, most, self._comm)
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


def marked(error, allowed, comm):
    """How often to refine each cell: the fewest that bring the sum of the errors below what is allowed.

    Collective on comm.  Cells whose children would be among the largest again are refined twice.  Where that does not
    suffice, the others keep little of what is allowed.

    Args:
        error: (ncells,) float64, of this rank's cells.
        allowed: sum of the errors of all ranks' cells that is allowed.
        comm: MPI communicator.

    Returns:
        (ncells,) int8, 0, 1 or 2.
    """
    largest = comm.allreduce(float(error.max(initial=0.0)), op=MPI.MAX)
    thresholds = np.geomspace(1.0, _LEAST, _THRESHOLDS) * largest
    # The first threshold, from the highest down, that a cell exceeds, and that its children would.
    places = [np.searchsorted(-thresholds, -share * error, side="right") for share in (1.0, _CHILD)]
    sums = np.stack([np.bincount(place, error, _THRESHOLDS + 1) for place in places])
    comm.Allreduce(MPI.IN_PLACE, sums)
    once, twice = np.cumsum(sums, axis=1)
    left = once[-1] - (1 - _CHILDREN) * (once + _CHILDREN * twice)
    enough = (left <= _AIM * allowed) | (once[-1] - once <= _KEPT * allowed)
    return sum((place <= int(np.argmax(enough))).astype(np.int8) for place in places)
