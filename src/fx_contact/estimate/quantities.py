"""Quantities of interest that a run holds to tolerances of their own, by adjoint solutions (`dual_weighted`)."""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fx_contact.estimate.marking import for_goal
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_name, check_number, check_vector, shown


@dataclass(frozen=True)
class ContactForce:
    """The force of a contact pair, as in `StepRecord.pair_forces`.

    Attributes:
        pair: name of the contact pair, "first on second" (`ContactPair.name`).
        tolerance: allowed error relative to the force [-].

    Raises:
        SceneError: the tolerance is no positive number.
    """

    pair: str
    tolerance: float

    def __post_init__(self):
        check_number(f"the tolerance of {self!r}", self.tolerance, positive=True)

    @property
    def name(self):
        """As records have it."""
        return f"force of {self.pair}"


@dataclass(frozen=True)
class Gap:
    """The gap left at a node pair, along the normal; 0 where it is closed.

    Attributes:
        pair: name of the contact pair, "first on second" (`ContactPair.name`).
        point: three numbers, near which the node pair is: the nearest undeformed one on the first surface [m].
        tolerance: allowed error relative to the gap [-].

    Raises:
        SceneError: the tolerance is no positive number, or the point not three numbers.
    """

    pair: str
    point: tuple[float, float, float]
    tolerance: float

    def __post_init__(self):
        check_vector("the point of a Gap", self.point)
        check_number(f"the tolerance of {self!r}", self.tolerance, positive=True)

    @property
    def name(self):
        """As records have it."""
        return f"gap of {self.pair} at {', '.join(f'{x:g}' for x in self.point)}"


@dataclass(frozen=True)
class GoalRecord:
    """What a step says of a goal.

    Attributes:
        name: of the goal.
        value: force of the whole bodies [N], or gap [m].
        error: estimated error, in the unit of the value; None: not estimated, before the energy error meets its
            tolerance, or for the force of an open pair.
        tolerance: allowed error relative to the value [-].
        reached: whether the error is known to be within the tolerance; of a pair that is open the gaps are judged
            (`contact_goals`).
    """

    name: str
    value: float
    error: float | None
    tolerance: float
    reached: bool


def check_goals(goals, scene):
    """Goals as a tuple.

    Local.

    Args:
        goals: sequence of ContactForce and Gap.
        scene: Scene.

    Raises:
        SceneError: there is another thing among them, or they name no contact pair of the scene.
    """
    if not isinstance(goals, (tuple, list)):
        raise SceneError(f"goals must be a tuple of ContactForce and Gap, got {shown(goals)}")
    for goal in goals:
        if not isinstance(goal, (ContactForce, Gap)):
            raise SceneError(f"a goal must be a ContactForce or a Gap, got {shown(goal)}")
        check_name("contact pair", goal.pair, [pair.name for pair in scene.contact])
    return tuple(goals)


def judge_goals(goals, duals, state, forces, theta, control):
    """Values and estimated errors of goals, and the cells to refine for them.

    Collective on state.forest.comm.  The error is sum_T |(e_u, e_z)_T| / theta, of the recovered errors of u and of the
    adjoint solution z (`dual_weighted.Goals.products`).  It takes that closed node pairs stay closed.

    Args:
        goals: sequence of ContactForce and Gap.
        duals: dual_weighted.Goals of the state; None: no errors are wanted yet.
        state: SolvedState.
        forces: list of float, `pair_forces` of the record [N].
        theta: effectivity by which estimated errors are corrected [-].
        control: ErrorControl.

    Returns:
        tuple of GoalRecord, and (n,) int8, how often to refine each leaf.
    """
    comm, leaf = state.forest.comm, state.elasticity.leaf_mesh.leaf
    pairs, names = state.pairs, [pair.name for pair in state.scene.contact]
    records, refine = [], np.zeros(len(state.forest), dtype=np.int8)
    for goal in goals:
        index, force = names.index(goal.pair), isinstance(goal, ContactForce)
        weight = None if force else _nearest(comm, pairs, index, np.array(goal.point, np.float64))
        if force:
            value = forces[index]
        else:
            value = comm.allreduce(float((weight * np.maximum(-state.solution.penetration, 0.0)).sum()))
        error, reached = None, force and not value
        if duals is not None and not reached:
            found = duals.force(index) if force else duals.gap(weight)
            scale = value / found.value if force else 1.0
            products = duals.products(found)
            total = comm.allreduce(float(products.sum()))
            error = scale * total / theta
            times = _needed(found, products, total, goal.tolerance * value * theta / scale, control, comm)
            reached = times is None
            times = 0 if reached else times
            refine[leaf] = np.maximum(refine[leaf], times)
        records.append(GoalRecord(goal.name, float(value), error, float(goal.tolerance), bool(reached)))
    return tuple(records), refine


def _needed(found, products, total, allowed, control, comm):
    """The cells to refine for the allowed error of a Goal: (ncells,) int8; None if it has no more.  Collective."""
    dual, limit = found.dual, control.dual_limit
    if dual.relative > limit:  # it knows nothing yet
        return for_goal(dual.error**2, (limit * dual.energy_norm) ** 2, dual.child_error, control, comm)
    return for_goal(products, allowed, dual.child_error, control, comm) if total > allowed else None


def _nearest(comm, pairs, index, point):
    """Weights (n,) float64: 1 for the node pair of a contact pair that is nearest to a point, 0 for the others.

    Collective on comm.  Of several the first by position is taken, so that ranks do not matter.
    """
    ours = np.flatnonzero(pairs.contact == index)
    distance = np.linalg.norm(pairs.position[ours] - point, axis=1)
    least = comm.allreduce(float(distance.min(initial=np.inf)), op=MPI.MIN)
    near = ours[distance <= least * (1 + 1e-9)]
    first = min(comm.allgather(min(map(tuple, pairs.position[near]), default=(np.inf,) * 3)))
    weight = np.zeros(len(pairs))
    weight[near[(pairs.position[near] == first).all(axis=1)]] = 1.0
    return weight
