"""What of the error is contact's own: between its nodes, in its forces, and of a penalty."""

from dataclasses import dataclass, field

import numpy as np
from mpi4py import MPI

from fx_contact.spots import Spots
from fx_contact.stored import stored_by_forces
from fx_contact.unseen import unseen_contact

#: The estimate that forces need is aimed at below, and not at less than so much of the present one.
_AIM, _LEAST_AIM = 0.9, 0.5
#: Near a contact beside heavier loads forces may be wrong by so many times more than what refinement changed tells.
_HIDDEN = 10.0
#: The error that a gap may have so that it is one, relative to it; and the least, relative to what it has changed by.
_OPEN, _CLOSED = 0.5, 1e-6


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
    bends a beam towards it, the changes of its force tell (`aim_of_forces`).

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
    gaps, closed = _gaps(pairs, contact, len(forces))
    extrapolated, change = _extrapolated(np.array(forces), gaps, closed, estimate.relative, before)
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

    share = _over(_over(force, of_pairs(force)[spots.contact]), stored.energy)
    of_force, held = of_pairs(share * off), of_pairs(share * overlap)
    most = _allowed(forces, tolerance, trusted)
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


def aim_of_forces(record, tolerance):
    """The estimate that the forces of contact pairs need, or None where they are as right as they should be.

    Local.

    Args:
        record: of the step.
        tolerance: prescribed accuracy e [-].
    """
    errors = _known(record["pair_errors"]) / _allowed(record["pair_forces"], tolerance, tolerance)
    worst = errors.max(initial=0.0)
    return record["estimate"] * max(_LEAST_AIM, _AIM / np.sqrt(worst)) if worst > 1 and record["estimate"] else None


def _allowed(forces, tolerance, trusted):
    """Relative errors that forces of contact pairs [N], or gaps without one, may have: (npairs,) float64 [-]."""
    forces = np.abs(forces)
    most = np.maximum(trusted, _over(tolerance**2 * forces.max(initial=0.0), forces))
    return np.where(forces > 0, most, _OPEN)


def _gaps(pairs, contact, count):
    """The least gap of each contact pair's nodes, and the most that one has changed: two (count,) float64 [m].

    Collective.
    """
    ends = np.full((2, count), np.inf)
    np.minimum.at(ends[0], pairs.contact, -contact.penetration)
    np.minimum.at(ends[1], pairs.contact, -np.abs(pairs.gap + contact.penetration))
    pairs.prolongation.comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MIN)
    return np.maximum(ends[0], 0.0), -ends[1]


def _extrapolated(forces, gaps, closed, estimate, before):
    """Errors of contact pairs' forces and gaps, as what is left falls with the square of the estimate.

    Local.  Where refinement has lowered that by less than a half, it has been local, and tells nothing of the rest.

    Args:
        forces: (npairs,) float64, `pair_forces` of the record [N].
        gaps: (npairs,) float64, the least that are left [m].
        closed: (npairs,) float64, the most that gaps have changed [m].
        estimate: xi / omega [-].
        before: record of the step before, or None.

    Returns:
        two (npairs,) float64: relative errors, of forces, at most 1 and that where contact is new, of gaps where there
        is no force, inf where nothing is known; and the relative changes of forces by refinement for their sake, inf
        where there was none [-].
    """
    if before is None:
        return np.full((2, len(forces)), np.inf)
    last, last_gaps = np.array(before["pair_forces"]), np.array(before["pair_gaps"])
    lowered = min((estimate / before["estimate"]) ** 2, 1.0) if before["estimate"] else 1.0
    change = _over(np.abs(forces - last), np.abs(forces))
    opened = np.abs(gaps - last_gaps)
    opened[opened <= _CLOSED * closed] = 0.0
    error = np.where(forces != 0, change, opened / np.maximum(gaps, _CLOSED * closed + np.finfo(float).tiny))
    if lowered <= 0.5:
        error *= lowered / (1 - lowered)
    else:
        error += _known(before["pair_errors"]) * lowered
    error[forces != 0] = np.minimum(error, 1.0)[forces != 0]
    error[(last == 0) & (forces != 0)] = 1.0
    return error, np.where(np.array(before["pair_leaves"]) > 0, change, np.inf)


def _known(errors):
    """Errors of a record as (npairs,) float64, 0 where they are not known."""
    return np.nan_to_num(np.array(errors, dtype=float))


def _over(part, whole):
    """The quotient of two non-negative numbers or arrays, 0 where the second is."""
    return np.divide(part, whole, out=np.zeros(len(whole)), where=whole > 0)
