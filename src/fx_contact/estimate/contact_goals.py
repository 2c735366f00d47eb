"""Error contributions of contact: its forces, the gap between its nodes, and a penalty."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fx_contact.estimate.contact_quantities import ContactForce
from fx_contact.estimate.dual_weighted import Goal
from fx_contact.estimate.goal_errors import JudgedGoal
from fx_contact.estimate.inter_node_gap import GapBetweenNodes
from fx_contact.estimate.solved_state import SolvedState
from fx_contact.parallel.arrays import Int8Array


@dataclass(frozen=True, eq=False)
class ContactError:
    """Errors of contact in a step, and the leaves to refine for contact and goals.

    Attributes:
        refine: (n,), number of refinements of each leaf.
        leaves: number of leaves to refine on all ranks.
        penetrated_leaves: number of leaves on all ranks that are penetrated between nodes; None: not computed.
        pair_errors: estimated error of the force of each contact pair, relative to it; None: not computed, before (6)
            is met, or no force [-].
        pair_leaves: number of leaves on all ranks that the force of each pair needs.
        penalty_share: `penalty_share`, the largest of all contact pairs; None: not computed [-].
    """

    refine: Int8Array
    leaves: int
    penetrated_leaves: int | None
    pair_errors: list[float | None]
    pair_leaves: list[int]
    penalty_share: float | None


def force_goals(names: Sequence[str], forces: Sequence[float], tolerance: float) -> dict[int, ContactForce]:
    """Goals for the positive forces of contact pairs, by the index of the pair.

    Local.  With a tolerance e the error may be e times the exact force, or e^2 times the largest force, but less than
    the exact force.
    """
    largest = max(map(abs, forces), default=0.0)
    allowed = {i: max(tolerance, tolerance**2 * largest / force) for i, force in enumerate(forces) if force > 0}
    return {i: ContactForce(names[i], 1 / (1 + 1 / share)) for i, share in allowed.items()}


def contact_error(
    state: SolvedState, between: GapBetweenNodes | None, forces: dict[int, JudgedGoal], of_user: Sequence[JudgedGoal]
) -> ContactError:
    """The errors of contact in a step, and the leaves to refine for contact and goals.

    Collective on state.forest.comm.  `forces` are the judged `force_goals`, `of_user` the goals of the user.  Without
    `between` errors of contact are not controlled.
    """
    comm, pairs = state.forest.comm, range(len(state.scene.contact))
    missed = np.zeros(len(state.forest), dtype=bool) if between is None else between.penetrated()
    refine = np.max([missed.astype(np.int8), *(goal.refine for goal in (*forces.values(), *of_user))], axis=0)
    penetrated_leaves, leaves = comm.allreduce(np.array([missed.sum(), (refine > 0).sum()])).tolist()
    known = ((i, judged.record.error, judged.record.value) for i, judged in forces.items())
    errors = {i: error / force for i, error, force in known if error is not None}
    shares = [penalty_share(state, judged.goal) for judged in forces.values() if judged.goal is not None]
    return ContactError(
        refine=refine,
        leaves=leaves,
        penetrated_leaves=None if between is None and pairs else penetrated_leaves,
        pair_errors=[errors.get(i) for i in pairs],
        pair_leaves=[forces[i].leaves if i in forces else 0 for i in pairs],
        penalty_share=max(shares, default=None if pairs else 0.0),
    )


def penalty_share(state: SolvedState, force: Goal) -> float:
    """Relative loss of a force F by the penetration of a penalty: int p_z max(-g, 0) dA / F, about 1 - F / F_exact [-].

    Collective on state.forest.comm.
    """
    work = float((force.pressure * state.contact_rows.area) @ state.solution.penetration)
    return abs(state.forest.comm.allreduce(work)) / force.value
