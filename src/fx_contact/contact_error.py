"""What of the error is contact's own: between its nodes, next to it, and of a penalty."""

from dataclasses import dataclass, field

import numpy as np

from fx_contact.force_error import allowed_errors, extrapolated_errors, least_gaps, quotient
from fx_contact.spots import Spots
from fx_contact.stored import stored_by_forces
from fx_contact.unseen import unseen_contact

#: Near a contact beside heavier loads forces may be wrong by so many times more than what refinement changed tells.
_HIDDEN = 10.0


@dataclass(frozen=True, eq=False)
class ContactError:
    """How well a step resolves contact.

    Attributes:
        refine: (n,) bool, this rank's leaves to refine for contact, whatever the estimate of the whole says.
        leaves: number of these on all ranks.
        unseen: number of those on all ranks that contact between nodes needs (`unseen_contact`).
        of_pairs: list of float, for each contact pair the estimated error of its work, relative to it [-].
        gaps: list of float, for each contact pair the least gap that is left at its nodes [m].
        of_forces: list of float, for each contact pair the error of its force, or without one of its least gap,
            extrapolated, relative to it; None where nothing is known [-].
        leaves_of_pairs: list of int, number of those on all ranks that the force of each contact pair needs.
        penalty_share: the most that overlaps take of a contact pair's force, about [-].
    """

    refine: np.ndarray
    leaves: int = 0
    unseen: int = 0
    of_pairs: list = field(default_factory=list)
    gaps: list = field(default_factory=list)
    of_forces: list = field(default_factory=list)
    leaves_of_pairs: list = field(default_factory=list)
    penalty_share: float = 0.0


def contact_error(forest, elasticity, pairs, contact, estimate, poisson, tolerance, trusted, forces, before):
    """Judge the contact of a step.

    Collective on forest.comm.  A spot's force times its approach is about the energy E that it stores.  What the error
    xi_T of a leaf's strains does to that is at most xi_T z_T (Cauchy and Schwarz), with z_T^2 the part of E in the
    leaf, whatever loads the error comes from.  The sum over the leaves, relative to E, is no more than the estimate
    where contact alone loads bodies, and more next to heavier loads.  As errors are orthogonal to what the mesh can
    resolve, its square is about the relative error of the force; less if refining has changed that by less.
    Contact pairs may have e of their force, e^2 of the largest one, or what the linear solver leaves; where they have
    more, leaves with more than their share are to be refined.  Of what is wrong far from a contact, as where a load
    bends a beam towards it, the changes of its force tell (`force_error`).

    Args:
        forest: Forest.
        elasticity: Elasticity.
        pairs: NodePairs.
        contact: ContactSolution.
        estimate: Estimate.
        poisson: (nbodies,) float64 [-].
        tolerance: prescribed accuracy e [-].
        trusted: the same, less where the estimate sees only a part of the error [-].
        forces: list of float, `pair_forces` of the record [N].
        before: record of the step before, or None.

    Returns:
        ContactError.
    """
    gaps, closed = least_gaps(pairs, contact, len(forces))
    extrapolated, change = extrapolated_errors(np.array(forces), gaps, closed, estimate.relative, before)
    spots = Spots(forest, pairs, contact.active)
    stored = stored_by_forces(forest, elasticity, poisson, estimate, pairs, contact.force, spots.pair, spots.number)
    unseen = unseen_contact(forest, pairs, contact, tolerance, spots, stored.energy)
    error = np.empty(len(forest))
    error[elasticity.leaf_mesh.leaf] = estimate.error
    error = error[stored.leaf] * np.sqrt(stored.of_leaf)  # of the energy

    presses, number = spots.pair >= 0, spots.number
    spot, force = spots.pair[presses], contact.force[presses]
    sums = [np.bincount(spot, force, number), np.bincount(spot, force * contact.penetration[presses], number)]
    sums += [np.bincount(stored.group, column, number) for column in (error, np.ones_like(error))]
    force, overlap, off, leaves = forest.comm.allreduce(np.stack(sums))
    off[off <= contact.energy_error**2] = 0.0

    def of_pairs(of_spots):
        """Sums over the spots of each contact pair: (npairs,) float64."""
        return np.bincount(spots.contact, of_spots, len(forces))

    share = quotient(quotient(force, of_pairs(force)[spots.contact]), stored.energy)
    of_force, held = of_pairs(share * off), of_pairs(share * overlap)
    most = allowed_errors(forces, tolerance, trusted)
    # Before the whole is resolved, refining it may do for the forces too.
    resolved = (estimate.relative > trusted) | (
        np.minimum.reduce([of_force**2, change, _HIDDEN * extrapolated]) <= most
    )
    share_of_leaf = np.where(resolved, np.inf, np.sqrt(most) / np.maximum(of_pairs(leaves), 1))
    pair = spots.contact[stored.group]
    more = share[stored.group] * error > share_of_leaf[pair]
    refine = unseen.copy()
    refine[stored.leaf[more]] = True
    totals = [*np.bincount(pair[more], minlength=len(forces)), unseen.sum(), refine.sum()]
    *of_leaves, unseen, leaves = forest.comm.allreduce(np.array(totals, dtype=int)).tolist()
    return ContactError(
        refine,
        leaves,
        unseen,
        of_force.tolist(),
        gaps.tolist(),
        [error if error < np.inf else None for error in extrapolated.tolist()],
        of_leaves,
        float(held.max(initial=0.0)),
    )
