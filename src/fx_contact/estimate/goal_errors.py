"""Errors of the quantities of interest that the user asks for, and the cells to refine for them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from mpi4py import MPI

from fx_contact.contact.pressure import leaves_of_rows
from fx_contact.estimate.contact_quantities import ContactForce, FrictionForce, Gap, MaxPressure
from fx_contact.estimate.dual_weighted import Functional, Goal, Goals
from fx_contact.estimate.error_control import ErrorControl
from fx_contact.estimate.marking import for_goal
from fx_contact.estimate.quantities import Displacement, Quantity, Reaction
from fx_contact.estimate.solved_state import SolvedState
from fx_contact.parallel.arrays import FloatArray, Int8Array
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import LEAST_TOLERANCE, percent, shown
from fx_contact.scene.scene import Scene

_KINDS = ContactForce, FrictionForce, Gap, MaxPressure, Displacement, Reaction


def check_goals(goals: Sequence[Quantity], scene: Scene) -> tuple[Quantity, ...]:
    """Goals as a tuple.  Local.  Raises SceneError: one is of another type, or of a place that the scene lacks."""
    kinds = ", ".join(kind.__name__ for kind in _KINDS)
    if not isinstance(goals, (tuple, list)):
        raise SceneError(f"goals must be a tuple of {kinds}, got {shown(goals)}")
    for goal in goals:
        if not isinstance(goal, Quantity):
            raise SceneError(f"a goal must be one of {kinds}, got {shown(goal)}")
        goal.check(scene)
    return tuple(goals)


@dataclass(frozen=True)
class GoalRecord:
    """Value and estimated error of a goal in a step.

    Attributes:
        value: of the bodies with their mirror images, [N], [m] or [Pa].
        error: estimated error, in that unit; None: not estimated, since the energy error exceeds its tolerance, or
            for the force and pressure of an open pair and a closed gap.
        allowed: error that the tolerance allows, in that unit.
        tolerance: relative [-].
        reached: True if the estimated error is within the tolerance, or for the force of an open pair (no error).
    """

    name: str
    value: float
    error: float | None
    allowed: float
    tolerance: float
    reached: bool

    @property
    def known(self) -> bool:
        """True if the estimated error is rounding: equilibrium or a condition fixes the value, or the mesh is exact."""
        return self.error is not None and self.error < LEAST_TOLERANCE * self.allowed / self.tolerance

    def __str__(self) -> str:
        size, error = self.allowed / self.tolerance, ""
        if self.known:
            error = ", fixed by equilibrium or conditions, or exact on this mesh: no test of its accuracy"
        elif self.error is None and self.reached:
            error = ", open or closed on this mesh: no test of its accuracy"
        elif self.error is not None and size:
            error = f", estimated error {percent(self.error / size)}"
        reached = "reached" if self.reached else "not reached"
        return f"{self.name}: {self.value:.6g}{error}, tolerance {percent(self.tolerance)} {reached}"


@dataclass(frozen=True, eq=False)
class JudgedGoal:
    """A goal, its error, and the leaves to refine for it.

    Attributes:
        refine: (n,), number of refinements of each leaf.
        leaves: number of leaves to refine on all ranks.
        goal: None: not estimated.
    """

    record: GoalRecord
    refine: Int8Array
    leaves: int
    goal: Goal | None


def judge_goals(
    goals: Sequence[Quantity],
    duals: Goals | None,
    state: SolvedState,
    residual: FloatArray,
    theta: float,
    control: ErrorControl,
) -> tuple[JudgedGoal, ...]:
    """Values and estimated errors of goals, and the leaves to refine for them.

    Collective on state.forest.comm.  The error is that of `dual_weighted` over theta, for a fixed set of closed rows.
    Goals of one quantity share an adjoint solution.

    Args:
        duals: of the state; None: no errors are wanted yet.
        residual: (owned, 3), `nodal_residual` of the state [N].
        theta: effectivity by which estimated errors are divided [-].
    """
    comm, known = state.forest.comm, dict[Quantity, tuple[Functional, Goal | None]]()
    for quantity in sorted(goals, key=lambda goal: float(goal.tolerance)):
        key = _without_tolerance(quantity)
        if key not in known:
            functional = quantity.functional(state, residual)
            goal = None
            if duals is not None and functional.depends(comm):
                goal = duals.of(functional, theta * quantity.tolerance * functional.size)
            known[key] = functional, goal

    def judged(quantity: Quantity) -> JudgedGoal:
        """A goal by its functional and error.  Collective."""
        functional, goal = known[_without_tolerance(quantity)]
        refine = np.zeros(len(state.forest), dtype=np.int8)
        allowed, error, reached = quantity.tolerance * functional.size, None, duals is not None
        if goal is not None:
            weighted = goal.total / theta
            local = comm.allreduce(float(functional.local.max(initial=0.0)), op=MPI.MAX)
            error = weighted + local
            reached = error <= allowed
            share = max(allowed - local, allowed / 2)
            if not reached and weighted > share:
                times = for_goal(goal.error, share * theta, goal.dual.child_error, control.target, comm)
                refine[state.elasticity.leaf_mesh.leaf] = times
            share = max(allowed - weighted, allowed / 2)
            if not reached and local > share:
                np.maximum(refine, _for_local(state, functional.local, control.target * share), out=refine)
        record = GoalRecord(quantity.name, functional.value, error, allowed, float(quantity.tolerance), reached)
        return JudgedGoal(record, refine, comm.allreduce(int((refine > 0).sum())), goal)

    return tuple(map(judged, goals))


def _without_tolerance(quantity: Quantity) -> Quantity:
    return replace(cast(Any, quantity), tolerance=0.5)


def _for_local(state: SolvedState, local: FloatArray, aim: float) -> Int8Array:
    """Number of refinements of each leaf (n,) for local errors (rows,) up to `aim`, if they are smooth.  Collective."""
    refine = np.zeros(len(state.forest), dtype=np.int8)
    for times in (1, 2):
        refine[leaves_of_rows(state.contact_rows, local > 4 ** (times - 1) * aim)] = times
    return refine
