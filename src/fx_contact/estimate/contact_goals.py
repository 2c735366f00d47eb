"""What of the error is contact's own: between its nodes, of its forces and gaps, and of a penalty."""

from dataclasses import dataclass

import numpy as np

from fx_contact.contact.contact_patches import Spots
from fx_contact.estimate.candidate_contact import moved_by_strains, openings
from fx_contact.estimate.contact_energy import stored_by_forces
from fx_contact.estimate.contact_places import Places
from fx_contact.estimate.goal_verdict import Verdict, allowed_errors
from fx_contact.estimate.inter_node_contact import unseen_contact


@dataclass(frozen=True, eq=False)
class ContactError:
    """How well a step resolves contact.

    Attributes:
        refine: (n,) int8, how often to refine each leaf of this rank for contact, whatever the estimate says.
        leaves: number of these on all ranks.
        unseen: number of those on all ranks that contact between nodes needs (`unseen_contact`).
        of_pairs: list of float, for each contact pair the estimated error of its force, with what places that may close
            would add, or a bound of it; without force the largest error of a gap; relative to the force or that gap.
            None where it was not asked for: before the whole is resolved [-].
        leaves_of_pairs: list of int, number of those on all ranks that the force or the gaps of each pair need.
        penalty_share: the most that overlaps take of a contact pair's force, about [-].
    """

    refine: np.ndarray
    leaves: int
    unseen: int | None
    of_pairs: list
    leaves_of_pairs: list
    penalty_share: float | None

    @classmethod
    def unknown(cls, leaves, pairs):
        """That of a step of so many leaves on this rank and so many contact pairs for which it is not asked.  Local."""
        unseen, share = (None, None) if pairs else (0, 0.0)
        return cls(np.zeros(leaves, dtype=np.int8), 0, unseen, [None] * pairs, [0] * pairs, share)


def contact_error(scene, forest, elasticity, pairs, contact, estimate, goals, forces, tolerance, control, history):
    """Judge the contact of a step.

    Collective on forest.comm.  Once the whole is resolved, the force of each contact pair is judged by its own (`Goal`)
    and may be off by e of it, or by e^2 of the largest one.  Its error is at most that of the whole, relative to the
    energy that the force stores, times that of the dual solution: where contact alone loads bodies this is less than
    what is allowed, and dual solutions are left out.  The gap of an open place (`openings`) may be off by a quarter, or
    by e^2 of what the strains contribute to it: less force than that pushes the bodies apart, if there is any.  Beside
    a force of the same contact pair it may also be off by what would make no more force than that may be off by.  Where
    the mesh knows little of a dual solution, its leaves are refined first.

    Args:
        scene: Scene.
        forest: Forest.
        elasticity: Elasticity.
        pairs: NodePairs.
        contact: ContactSolution.
        estimate: Estimate.
        goals: Goals.
        forces: list of float, `pair_forces` of the record [N].
        tolerance: prescribed accuracy e [-].
        control: ErrorControl.
        history: RefinementHistory.

    Returns:
        ContactError.
    """
    comm, spots = forest.comm, Spots(forest, pairs, contact.active)
    poisson = np.array([scene.materials[name].poisson for name in scene.mesh.bodies])
    places = Places(pairs, contact.force, spots.pair, spots.number)
    energy = stored_by_forces(forest, elasticity, poisson, estimate, places)
    unseen = unseen_contact(forest, pairs, contact, tolerance, spots, energy)

    presses = spots.pair >= 0
    work = np.bincount(spots.pair[presses], (contact.force * contact.penetration)[presses], spots.number)
    work = comm.allreduce(work)

    def summed(of_spots):
        """Sums over the spots of each contact pair: (npairs,) float64."""
        return np.bincount(spots.contact, of_spots, len(forces))

    force = np.where(np.array(forces) > 0, summed(places.force), 0.0)  # a pair that pulls at last does so by rounding
    share = _quotient(places.force, force[spots.contact])  # that each spot has of its contact pair's force [-]
    penalty_share = summed(_quotient(share * work, energy))
    # Spots are springs beside each other: the square of a pair's force over what it stores is the sum of theirs.
    inverse = np.divide(share**2, energy, out=np.where(share > 0, np.inf, 0.0), where=energy > 0)  # [1/J]
    bounds = np.zeros(len(forces))  # of the relative errors of forces, by that of the whole [-]
    seen = control.correction(history)
    if estimate.error_global:
        bounds = control.dual_error * estimate.error_global / seen * np.sqrt(summed(inverse))

    refine, errors, leaves = unseen.astype(np.int8), [None] * len(forces), [0] * len(forces)
    if control.sought(estimate, tolerance, history) is None:
        allowed = allowed_errors(forces, tolerance, seen)
        moved = moved_by_strains(scene, pairs, contact)
        surface = Spots(forest, pairs, np.ones(len(pairs), dtype=bool)).pair
        for index, bound in enumerate(bounds):
            verdict = Verdict(
                len(estimate.error), comm, float(force[index]), float(bound), float(allowed[index]), control
            )
            if bound > allowed[index]:
                verdict.judge_force(goals.force(index))
            around = places.around(pairs, spots.contact == index)
            for weight in openings(index, pairs, contact, moved, surface, around, control):
                goal = goals.gap(weight)
                verdict.judge_gap(goal, seen * max(control.gap_accuracy * goal.value, tolerance**2 * goal.moved))
            errors[index] = verdict.error
            leaves[index] = comm.allreduce(int((verdict.refine > 0).sum()))
            of_leaf = np.zeros_like(refine)
            of_leaf[elasticity.leaf_mesh.leaf] = verdict.refine
            np.maximum(refine, of_leaf, out=refine)
    unseen, total = comm.allreduce(np.array([unseen.sum(), (refine > 0).sum()])).tolist()
    return ContactError(refine, total, unseen, errors, leaves, float(penalty_share.max(initial=0.0)))


def _quotient(part, whole):
    """The quotient of two arrays of non-negative numbers, 0 where the second is."""
    return np.divide(part, whole, out=np.zeros(len(whole)), where=whole > 0)
