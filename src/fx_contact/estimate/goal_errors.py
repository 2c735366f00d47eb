"""Errors of the quantities of interest that the user asks for, and the cells to refine for them."""

from dataclasses import dataclass

import numpy as np

from fx_contact.estimate.marking import for_goal
from fx_contact.parallel.validation import percent


@dataclass(frozen=True)
class GoalRecord:
    """What a step says of a goal.

    Attributes:
        name: of the goal.
        value: of the whole bodies, in the unit of the quantity: [N], [m] or [Pa].
        error: estimated error, in that unit; None: not estimated, before the energy error meets its tolerance, or for
            the force and pressure of an open pair, and a gap that is closed.
        allowed: the error that the tolerance allows, in that unit.
        tolerance: of the goal, relative [-].
        reached: whether the error is known to be within the tolerance, or there is none to know: that of the force of
            an open pair.
    """

    name: str
    value: float
    error: float | None
    allowed: float
    tolerance: float
    reached: bool

    def __str__(self):
        size = self.allowed / self.tolerance
        error = "" if self.error is None or not size else f", estimated error {percent(self.error / size)}"
        reached = "reached" if self.reached else "not reached"
        return f"{self.name}: {self.value:.6g}{error}, tolerance {percent(self.tolerance)} {reached}"


def judge_goals(goals, duals, state, residual, theta, control):
    """Values and estimated errors of goals, and the cells to refine for them.

    Collective on state.forest.comm.  The error is sum_P |sum_T (e_u, e_z)_T| / theta, of the recovered errors of u and
    of the adjoint solution z (`dual_weighted.Goals.errors`).  It takes that closed node pairs stay closed.

    Args:
        goals: sequence of Quantity.
        duals: dual_weighted.Goals of the state; None: no errors are wanted yet.
        state: SolvedState.
        residual: (owned, 3) float64, its `nodal_residual` [N].
        theta: effectivity by which estimated errors are corrected [-].
        control: ErrorControl.

    Returns:
        tuple of GoalRecord, and (n,) int8, how often to refine each leaf.
    """
    comm, leaf = state.forest.comm, state.elasticity.leaf_mesh.leaf
    records, refine = [], np.zeros(len(state.forest), dtype=np.int8)
    for goal in goals:
        functional, error = goal.functional(state, residual), None
        allowed, reached = goal.tolerance * functional.size, duals is not None
        if duals is not None and functional.depends(comm):
            found = duals.of(functional)
            errors = duals.errors(found)
            error = comm.allreduce(float(errors.sum())) / theta
            reached = error <= allowed
            if not reached:
                times = for_goal(errors, allowed * theta, found.dual.child_error, control, comm)
                refine[leaf] = np.maximum(refine[leaf], times)
        records.append(GoalRecord(goal.name, functional.value, error, allowed, float(goal.tolerance), reached))
    return tuple(records), refine
