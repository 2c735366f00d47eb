"""Threshold marking: the cells with the largest errors are refined until the expected error is the allowed one."""

from collections.abc import Callable

import numpy as np
from mpi4py import MPI

from fx_contact.estimate.estimator import Estimate
from fx_contact.fem.space import child_error
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int8Array

#: Number of thresholds: each is 0.97 of the one before or more.
_THRESHOLDS = 1024
#: xi_T^2 of a child over that of its parent at the edge of a contact: the pressure there is as r^(1/2) (Johnson, as in
#: `contact_edge`), so is the stress, and xi_T^2 of a cell of size h as h^4 [-].
_CHILD_AT_EDGE = 2.0**-4
#: Relative difference of sums of errors that is rounding.
_SAME = 1e-9
#: The lowest one for goals over the largest error: a billion cells below it add up to 0.001 of that.
_LOWEST_FOR_GOALS = 1e-12


def by_criterion(estimate: Estimate, tolerance: float) -> BoolArray:
    """Cells of criterion (2), xi_T > e omega / sqrt(N), with e the tolerance [-]: (ncells,).  Local."""
    return estimate.error > _criterion(estimate, tolerance)


def expected_estimate(estimate: Estimate, times: Int8Array, comm: MPI.Intracomm) -> float:
    """xi / omega after refinements of each cell (ncells,) of a smooth solution [-].  Collective on comm."""
    left = float(np.sum(estimate.error**2 * (8 * estimate.child_error) ** times))
    return float(np.sqrt(comm.allreduce(left))) / estimate.energy_norm if estimate.energy_norm else 0.0


def for_tolerance(
    estimate: Estimate, tolerance: float, target: float, comm: MPI.Intracomm, loss_rate: float = 1.0
) -> Int8Array:
    """Number of refinements (ncells,), 0 to 2, for xi <= e omega, by the highest threshold expected to suffice.

    Collective on comm.  The aim is an error of `target` e omega; at degree 2 at least xi / 4, that after
    uniform refinement of a smooth solution.  The loss of xi^2 is predicted by that of the last refinement: at the edges
    of a punch it is half of that (demos/indentation.py).  Cells at the edge of contact are refined
    twice earlier (studies.effectivity.hertz_truth).  If threshold (2) is too high, it is `_equidistributing`.

    Args:
        tolerance: e [-].
        target: share of the tolerance, `ErrorControl.target` [-].
        loss_rate: loss of xi^2 by the last refinement over that of a smooth solution [-].
    """
    criterion = _criterion(estimate, tolerance)
    largest = comm.allreduce(float(estimate.error.max(initial=0)), op=MPI.MAX)
    if largest <= criterion:
        return np.zeros(len(estimate.error), dtype=np.int8)
    loss, child = 1 - 8 * estimate.child_error, estimate.child_error  # of xi_T^2, by eight children
    thresholds = np.geomspace(largest, criterion, _THRESHOLDS)
    later = _equidistributing(child) * criterion
    of_later = int(np.argmax(thresholds <= later)) if later < largest else len(thresholds) - 1
    aim = target * tolerance * estimate.energy_norm
    if child < child_error(1):
        aim = max(aim, np.sqrt(8 * child) * estimate.error_global)
    # Uniform refinement, where the aim is what it leaves, suffices whatever the rounding.
    need = (1 - _SAME) * (estimate.error_global**2 - aim**2)

    def choose(once: FloatArray, twice: FloatArray) -> int:
        """The highest threshold that suffices, as in `_mark`."""
        suffices = _lost(once, twice, loss_rate * loss)[:-1] >= need
        return int(np.argmax(suffices)) if suffices.any() else of_later

    at_edge = False if estimate.at_edge is None else estimate.at_edge
    children = np.where(at_edge, _CHILD_AT_EDGE, child)
    return _mark(estimate.error**2, children, thresholds**2, choose, comm)


def for_goal(error: FloatArray, allowed: float, child_error: float, target: float, comm: MPI.Intracomm) -> Int8Array:
    """Number of refinements (ncells,), 0 to 2, of the fewest cells for a sum of errors (ncells,) that is allowed.

    Collective on comm.  If refining twice does not suffice, the cells that are not refined keep the allowed sum.

    Args:
        child_error: error of a child over that of its parent, of smooth solutions [-].
        target: share of the allowed sum, `ErrorControl.target` [-].
    """
    largest = comm.allreduce(float(error.max(initial=0.0)), op=MPI.MAX)
    thresholds = np.geomspace(1.0, _LOWEST_FOR_GOALS, _THRESHOLDS) * largest

    def choose(once: FloatArray, twice: FloatArray) -> int:
        """The highest threshold that suffices, as in `_mark`."""
        kept = once[-1] - once
        left = kept + once - _lost(once, twice, 1 - 8 * child_error)
        aim = target * allowed
        return int(np.argmax((left <= aim) | (kept <= aim)))

    return _mark(error, child_error, thresholds, choose, comm)


def _criterion(estimate: Estimate, tolerance: float) -> float:
    """The threshold of criterion (2), e omega / sqrt(N) [J^(1/2)]."""
    return tolerance * estimate.energy_norm / float(np.sqrt(estimate.cells))


def _equidistributing(child_error: float) -> float:
    """The threshold tau of a mesh of N cells that meets the tolerance e, over e omega / sqrt(N).

    Refining above tau leaves xi_T^2 between c tau^2 and tau^2, c = `child_error`.  With ln xi_T uniform there, its mean
    is tau^2 (1 - c) / ln(1 / c) = (e omega)^2 / N, N that of the present mesh.
    """
    return float(np.sqrt(-np.log(child_error) / (1 - child_error)))


def _lost(once: FloatArray, twice: FloatArray, loss: float) -> FloatArray:
    """Loss of errors by a relative loss and the sums of those refined once or more, and twice."""
    return loss * (once + (1 - loss) * twice)


def _mark(
    error: FloatArray,
    child_error: float | FloatArray,
    thresholds: FloatArray,
    choose: Callable[[FloatArray, FloatArray], int],
    comm: MPI.Intracomm,
) -> Int8Array:
    """Number of refinements (ncells,) of cells above a threshold, 2 if a child's error would be.

    `child_error`, one or (ncells,), is that of a child over that of its parent.
    `choose` gives the position of a threshold, of descending ones (m,) and one below all errors, by two (m + 1,): the
    sums on all ranks of the errors of cells refined, and refined twice.
    """
    first = [np.searchsorted(-thresholds, -share * error, side="right") for share in (1.0, child_error)]
    sums = np.stack([np.bincount(place, error, len(thresholds) + 1) for place in first]).astype(float)
    comm.Allreduce(MPI.IN_PLACE, sums)
    once, twice = np.cumsum(sums, axis=1)
    chosen = choose(once, twice)
    return (first[0] <= chosen).astype(np.int8) + (first[1] <= chosen).astype(np.int8)
