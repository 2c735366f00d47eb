"""What of the error is contact's own: between its nodes, in its forces, and of a penalty."""

from dataclasses import dataclass, field

import numpy as np

from fx_contact.spots import Spots
from fx_contact.stored import stored_by_forces
from fx_contact.unseen import unseen_contact


@dataclass(frozen=True, eq=False)
class ContactError:
    """How well a step resolves contact.

    Attributes:
        refine: (n,) bool, this rank's leaves to refine for contact, whatever the estimate of the whole says.
        leaves: number of these on all ranks.
        unseen: number of those on all ranks that contact between nodes needs (`unseen_contact`).
        of_pairs: list of float, for each contact pair the estimated error of its work, relative to it [-].
        leaves_of_pairs: list of int, number of those on all ranks that the force of each contact pair needs.
        penalty_share: the most that overlaps take of a contact pair's force, about [-].
    """

    refine: np.ndarray
    leaves: int = 0
    unseen: int = 0
    of_pairs: list = field(default_factory=list)
    leaves_of_pairs: list = field(default_factory=list)
    penalty_share: float = 0.0


def contact_error(forest, elasticity, pairs, contact, estimate, poisson, tolerance, trusted, change):
    """Judge the contact of a step.

    Collective on forest.comm.  A spot's force times its approach is about the energy E that it stores.  What the error
    xi_T of a leaf's strains does to that is at most xi_T z_T (Cauchy and Schwarz), with z_T^2 the part of E in the
    leaf, whatever loads the error comes from.  The sum over the leaves, relative to E, is no more than the estimate
    where contact alone loads bodies, and more next to heavier loads.  As errors are orthogonal to what the mesh can
    resolve, its square is about the relative error of the force; less if refining there has changed that by less.
    Contact pairs may have e of their force, e^2 of the largest one, or what the linear solver leaves; where they have
    more, leaves with more than their share are to be refined.

    Args:
        forest: Forest.
        elasticity: Elasticity.
        pairs: NodePairs.
        contact: ContactSolution.
        estimate: Estimate.
        poisson: (nbodies,) float64 [-].
        tolerance: prescribed accuracy e [-].
        trusted: the same, less where the estimate sees only a part of the error [-].
        change: (npairs,) float64, relative change of each contact pair's force by the last refinement, inf where that
            was not for its sake [-].

    Returns:
        ContactError.
    """
    spots = Spots(forest, pairs, contact.active)
    stored = stored_by_forces(forest, elasticity, poisson, estimate, pairs, contact.force, spots.pair, spots.number)
    unseen = unseen_contact(forest, pairs, contact, tolerance, spots, stored.energy)
    error = np.empty(len(forest))
    error[elasticity.leaf_mesh.leaf] = estimate.error
    error = error[stored.leaf] * np.sqrt(stored.of_leaf)  # of the energy

    presses, number = spots.pair >= 0, spots.number
    spot, force = spots.pair[presses], contact.force[presses]
    sums = [np.bincount(spot, force, number), np.bincount(spot, force * contact.penetration[presses], number)]
    sums += [np.bincount(stored.group, column, number) for column in (error, error > 0)]
    force, overlap, off, leaves = forest.comm.allreduce(np.stack(sums))
    off[off <= contact.energy_error**2] = 0.0

    def of_pairs(of_spots):
        """Sums over the spots of each contact pair: (npairs,) float64."""
        return np.bincount(spots.contact, of_spots, len(change))

    force_of_pair = of_pairs(force)
    share = _over(force, force_of_pair[spots.contact]) / np.maximum(stored.energy, np.finfo(float).tiny)
    of_force, held = of_pairs(share * off), of_pairs(share * overlap)
    most = np.maximum(trusted, _over(tolerance**2 * force_of_pair.max(initial=0.0), force_of_pair))
    resolved = np.minimum(of_force**2, change) <= most
    share_of_leaf = np.where(resolved, np.inf, np.sqrt(most) / np.maximum(of_pairs(leaves), 1))
    pair = spots.contact[stored.group]
    more = share[stored.group] * error > share_of_leaf[pair]
    refine = unseen.copy()
    refine[stored.leaf[more]] = True
    totals = [*np.bincount(pair[more], minlength=len(change)), unseen.sum(), refine.sum()]
    *of_leaves, unseen, leaves = forest.comm.allreduce(np.array(totals, dtype=int)).tolist()
    return ContactError(refine, leaves, unseen, of_force.tolist(), of_leaves, float(held.max(initial=0.0)))


def _over(part, whole):
    """The quotient of two non-negative numbers or arrays, 0 where the second is."""
    return np.divide(part, whole, out=np.zeros(len(whole)), where=whole > 0)
