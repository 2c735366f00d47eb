"""Threshold marking: cells are refined, the largest errors first, until the error is expected to be what is allowed."""

import numpy as np
from mpi4py import MPI

from fx_contact.fem.space import child_error

#: How many thresholds are tried: each is 0.97 of the one before or more.
_THRESHOLDS = 1024
#: The lowest one for goals, relative to the largest error: what a billion cells below it add up to is nothing.
_LOWEST_FOR_GOALS = 1e-12


def by_criterion(estimate, tolerance):
    """Cells of criterion (2), xi_T > e omega / sqrt(N): (ncells,) bool.

    Local.

    Args:
        estimate: Estimate.
        tolerance: prescribed accuracy e [-].
    """
    return estimate.error > _criterion(estimate, tolerance)


def for_tolerance(estimate, tolerance, loss_rate, control, comm):
    """Cells to refine for xi <= e omega.

    Collective on comm.  The threshold is the highest with which xi is expected to be `control.target` times e omega,
    at degree 2 a quarter of the present xi at least: what refining all cells brings where the solution is smooth.  If
    not even that of criterion (2) is low enough, it is `_equidistributing`.

    Args:
        estimate: Estimate.
        tolerance: prescribed accuracy e [-].
        loss_rate: loss of xi^2 by refinement, over that of a smooth solution; None: unknown [-].
        control: ErrorControl.
        comm: MPI communicator of the mesh's forest.

    Returns:
        (ncells,) int8, how often to refine each cell, 0 to 2, and the loss of xi^2 if the solution is smooth [J].
    """
    criterion = _criterion(estimate, tolerance)
    largest = comm.allreduce(float(estimate.error.max(initial=0)), op=MPI.MAX)
    if largest <= criterion:
        return np.zeros(len(estimate.error), dtype=np.int8), 0.0
    loss, child = _smooth_loss(estimate.child_error), estimate.child_error
    thresholds = np.geomspace(largest, criterion, _THRESHOLDS)
    later = _equidistributing(child) * criterion
    of_later = int(np.argmax(thresholds <= later)) if later < largest else len(thresholds) - 1
    aim = control.target * tolerance * estimate.energy_norm
    if child < child_error(1):
        aim = max(aim, np.sqrt(8 * child) * estimate.error_global)
    need = estimate.error_global**2 - aim**2

    def choose(once, twice):
        """The highest threshold that suffices; as `_mark` wants it."""
        suffices = _lost(once, twice, loss * (loss_rate or 1.0))[:-1] >= need
        return int(np.argmax(suffices)) if suffices.any() else of_later

    times, once, twice = _mark(estimate.error**2, child, thresholds**2, choose, comm)
    return times, float(_lost(once, twice, loss))


def _smooth_loss(child_error):
    """The share of xi_T^2 that refining a cell takes where the solution is smooth: a cell has eight children.  Local.

    Args:
        child_error: xi_T^2 of a child over that of its parent, `Estimate.child_error` [-].
    """
    return 1 - 8 * child_error


def for_goal(error, allowed, child_error, control, comm):
    """The fewest cells to refine for a sum of errors below what is allowed.

    Collective on comm.  Where refining twice does not suffice, the cells that are not refined keep what is allowed.

    Args:
        error: (ncells,) float64, xi_T(u) xi_T(z) of this rank's cells, or other non-negative errors that add up.
        allowed: their sum on all ranks that is allowed.
        child_error: error of a child over that of its parent where the solutions are smooth [-].
        control: ErrorControl.
        comm: MPI communicator.

    Returns:
        (ncells,) int8, how often to refine each cell, 0 to 2.
    """
    largest = comm.allreduce(float(error.max(initial=0.0)), op=MPI.MAX)
    thresholds = np.geomspace(1.0, _LOWEST_FOR_GOALS, _THRESHOLDS) * largest

    def choose(once, twice):
        """The highest threshold that suffices; as `_mark` wants it."""
        kept = once[-1] - once
        left = kept + once - _lost(once, twice, _smooth_loss(child_error))
        aim = control.target * allowed
        return int(np.argmax((left <= aim) | (kept <= aim)))

    return _mark(error, child_error, thresholds, choose, comm)[0]


def _criterion(estimate, tolerance):
    """The threshold of criterion (2), e omega / sqrt(N) [J^(1/2)]."""
    return tolerance * estimate.energy_norm / np.sqrt(estimate.cells)


def _equidistributing(child_error):
    """The threshold tau of a mesh of N cells that meets the tolerance e, over e omega / sqrt(N).

    If all its cells come from refining above tau, xi_T^2 is between c tau^2 and tau^2, c = `child_error`.  With ln xi_T
    uniform there, its mean is tau^2 (1 - c) / ln(1 / c), and is to be (e omega)^2 / N.  N is taken of the present mesh.
    Where the last one has less than 4.9 times as many (3.6 at degree 1), (2) would make cells smaller than needed.
    """
    return np.sqrt(-np.log(child_error) / (1 - child_error))


def _lost(once, twice, loss):
    """What all errors lose if refinement takes the same share of each, those of cells refined once and twice given."""
    return loss * (once + (1 - loss) * twice)


def _mark(error, child_error, thresholds, choose, comm):
    """Refine cells whose error is above a threshold, twice where a child's would be.

    Args:
        error: (ncells,) float64, of this rank's cells.
        child_error: error of a child over that of its parent [-].
        thresholds: (m,) float64, descending.
        choose: function of two (m + 1,) float64, the errors on all ranks of the cells refined, and of those refined
            twice, by each threshold, the last of which is below all errors; returns the position of one.
        comm: MPI communicator.

    Returns:
        (ncells,) int8, and the two sums at the threshold chosen.
    """
    first = [np.searchsorted(-thresholds, -share * error, side="right") for share in (1.0, child_error)]
    sums = np.stack([np.bincount(place, error, len(thresholds) + 1) for place in first])
    comm.Allreduce(MPI.IN_PLACE, sums)
    once, twice = np.cumsum(sums, axis=1)
    chosen = choose(once, twice)
    return sum((place <= chosen).astype(np.int8) for place in first), once[chosen], twice[chosen]
