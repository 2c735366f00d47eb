"""Errors of contact forces, and of gaps that are left, as what refinement changes of them tells."""

import numpy as np
from mpi4py import MPI

#: The estimate that forces need is aimed at below, and not at less than so much of the present one.
_AIM, _LEAST_AIM = 0.9, 0.5
#: The error that a gap may have so that it is one, relative to it; and the least, relative to what it has changed by.
_OPEN, _CLOSED = 0.5, 1e-6


def aim_of_forces(record, tolerance):
    """The estimate that the forces of contact pairs need, or None where they are as right as they should be.

    Local.

    Args:
        record: of the step.
        tolerance: prescribed accuracy e [-].
    """
    errors = _known(record["pair_errors"]) / allowed_errors(record["pair_forces"], tolerance, tolerance)
    worst = errors.max(initial=0.0)
    return record["estimate"] * max(_LEAST_AIM, _AIM / np.sqrt(worst)) if worst > 1 and record["estimate"] else None


def allowed_errors(forces, tolerance, trusted):
    """Relative errors that forces of contact pairs, or gaps without one, may have.

    Local.

    Args:
        forces: (npairs,) float64, or a list, `pair_forces` of a record [N].
        tolerance: prescribed accuracy e [-].
        trusted: the same, less where the estimate sees only a part of the error [-].

    Returns:
        (npairs,) float64 [-].
    """
    forces = np.abs(forces)
    most = np.maximum(trusted, quotient(tolerance**2 * forces.max(initial=0.0), forces))
    return np.where(forces > 0, most, _OPEN)


def least_gaps(pairs, contact, count):
    """The least gap that is left at the nodes of each contact pair, and the most that one has changed.

    Collective.

    Args:
        pairs: NodePairs.
        contact: ContactSolution.
        count: number of contact pairs.

    Returns:
        two (count,) float64, 0 where a contact pair has no nodes [m].
    """
    ends = np.full((2, count), np.inf)
    np.minimum.at(ends[0], pairs.contact, -contact.penetration)
    np.minimum.at(ends[1], pairs.contact, -np.abs(pairs.gap + contact.penetration))
    pairs.prolongation.comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MIN)
    ends[~np.isfinite(ends)] = 0.0
    return np.maximum(ends[0], 0.0), -ends[1]


def extrapolated_errors(forces, gaps, closed, estimate, before):
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
    change = quotient(np.abs(forces - last), np.abs(forces))
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


def quotient(part, whole):
    """The quotient of two non-negative numbers or arrays, 0 where the second is.  Local."""
    return np.divide(part, whole, out=np.zeros(len(whole)), where=whole > 0)
