"""Error contributions of contact: its forces, the gap between its nodes, and a penalty."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from mpi4py import MPI

from fx_contact.estimate.dual_weighted import Goal
from fx_contact.estimate.goal_errors import JudgedGoal
from fx_contact.estimate.inter_node_gap import GapBetweenNodes
from fx_contact.estimate.quantities import ContactForce
from fx_contact.estimate.solved_state import SolvedState
from fx_contact.parallel.arrays import Int8Array


@dataclass(frozen=True, eq=False)
class ContactError:
    """Error contributions of the contact discretisation in a step.

    Attributes:
        refine: (n,), number of refinements of each leaf of this rank for contact and goals.
        leaves: number of these leaves on all ranks.
        between_nodes: number of those on all ranks that are penetrated between nodes; None: not computed.
        of_pairs: for each contact pair the estimated error of its force, relative to it; None: not computed, before
            (6) is met, or no force [-].
        leaves_of_pairs: number of leaves on all ranks that the force of each pair needs.
        penalty_share: `penalty_share`, the largest of all contact pairs; None: not computed [-].
    """

    refine: Int8Array
    leaves: int
    between_nodes: int | None
    of_pairs: list[float | None]
    leaves_of_pairs: list[int]
    penalty_share: float | None

    @classmethod
    def unknown(cls, leaves: int, pairs: int) -> "ContactError":
        """No error, of a step of so many leaves on this rank and so many contact pairs.  Local."""
        between_nodes, share = (None, None) if pairs else (0, 0.0)
        return cls(np.zeros(leaves, dtype=np.int8), 0, between_nodes, [None] * pairs, [0] * pairs, share)

    def with_more(self, goals: Sequence[JudgedGoal], comm: MPI.Intracomm) -> "ContactError":
        """Contact error with the leaves to refine for goals of the user added.  Collective on comm."""
        refine = np.max([self.refine, *(goal.refine for goal in goals)], axis=0)
        return replace(self, refine=refine, leaves=comm.allreduce(int((refine > 0).sum())))


def force_goals(names: Sequence[str], forces: Sequence[float], tolerance: float) -> dict[int, ContactForce]:
    """Goals for the positive forces of contact pairs, by the position of the pair.

    Local.  The error may be e times the exact force, or e^2 times the largest force, but less than the exact force.

    Args:
        names: of the contact pairs.
        forces: `pair_forces` of the record [N].
        tolerance: prescribed accuracy e [-].
    """
    largest = max(map(abs, forces), default=0.0)
    allowed = {i: max(tolerance, tolerance**2 * largest / force) for i, force in enumerate(forces) if force > 0}
    return {i: ContactForce(names[i], 1 / (1 + 1 / share)) for i, share in allowed.items()}


def contact_error(state: SolvedState, between: GapBetweenNodes, forces: dict[int, JudgedGoal]) -> ContactError:
    """The errors of contact in a step, and the leaves to refine for them.

    Collective on state.forest.comm.  Penetration between nodes is checked in each step, forces once (6) is met.

    Args:
        between: of the state.
        forces: the judged `force_goals`.
    """
    comm, pairs = state.forest.comm, range(len(state.scene.contact))
    missed = between.penetrated()
    refine = np.max([missed.astype(np.int8), *(judged.refine for judged in forces.values())], axis=0)
    between_nodes, total = comm.allreduce(np.array([missed.sum(), (refine > 0).sum()])).tolist()
    goals = {i: judged.goal for i, judged in forces.items() if judged.goal is not None}
    errors = {
        i: judged.record.error / judged.record.value
        for i, judged in forces.items()
        if judged.record.error is not None
    }
    return ContactError(
        refine=refine,
        leaves=total,
        between_nodes=between_nodes,
        of_pairs=[errors.get(i) for i in pairs],
        leaves_of_pairs=[forces[i].leaves if i in forces else 0 for i in pairs],
        penalty_share=max((penalty_share(state, goal) for goal in goals.values()), default=None),
    )


def penalty_share(state: SolvedState, force: Goal) -> float:
    """Relative loss of a contact pair's force by the penetration of a penalty [-].

    Collective on state.forest.comm.  By the adjoint solution of the force F it is int p_z max(-g, 0) dA / F, about
    1 - F / F_e with the force F_e of exact contact.
    """
    assert state.pairs is not None
    work = float((force.pressure * state.pairs.area) @ state.solution.penetration)
    return abs(state.forest.comm.allreduce(work)) / force.value
