"""A solved step as the start of a run of another scene on the same root mesh."""

import numpy as np
from mpi4py import MPI

from fx_contact.adaptive.beginning import Beginning
from fx_contact.adaptive.checkpoint import State
from fx_contact.estimate.effectivity import RefinementHistory
from fx_contact.estimate.error_control import ErrorControl
from fx_contact.fem.space import Space
from fx_contact.forest.coarsening import coarsened
from fx_contact.forest.forest import Forest
from fx_contact.parallel.arrays import FloatArray, Int8Array
from fx_contact.problem import hexahedron


def carried_over(state: State, tolerance: float, control: ErrorControl, kind: str) -> Beginning:
    """The coarsened forest of a state, and its displacement there, a first guess.

    Collective on state.forest.comm.  A leaf merges with its siblings while their parent, where the solution is smooth,
    has at most an error tau / sqrt(N).  Criterion (2) refines cells above e omega / sqrt(N); tau is e omega times what
    two refinements divide the error of a cell by, the most of one marking.  Such a run has at least two meshes, and
    measures the effectivity of the estimator.

    Args:
        state: of the last step.
        tolerance: prescribed accuracy e [-].
        kind: of partition, a key of `partition.KINDS`.
    """
    forest, estimate, history = state.forest, state.estimate, state.history
    allowed = (control.correction(history) * tolerance * estimate.energy_norm) ** 2 / estimate.cells
    merges = _merges(estimate.error**2, allowed / estimate.child_error**2, estimate.child_error, forest.level)
    history = RefinementHistory(history.effectivity)
    if not forest.comm.allreduce(bool(merges.any()), op=MPI.LOR):
        return Beginning(forest, state.values, history)
    merged = coarsened(forest, forest.level - merges, kind)
    return Beginning(merged, _on_nodes(forest, state.values, merged), history)


def _merges(error2: FloatArray, allowed: float, child_error: float, level: Int8Array) -> Int8Array:
    """Merges (n,) of leaves: xi_T^2 of the ancestor k levels above is child_error^(-k) times theirs, at most tau^2."""
    ancestors = np.arange(1, int(level.max(initial=0)) + 1)
    small = error2[:, None] <= allowed * child_error**ancestors
    return np.minimum(small.sum(axis=1), level).astype(np.int8)


def _on_nodes(forest: Forest, values: FloatArray, merged: Forest) -> FloatArray:
    """Nodal values (n, (p+1)^3, k) on a coarser forest, whose nodes are nodes of the finer one.  Collective."""
    degree = hexahedron.order_of(values.shape[1])
    before, after = Space(forest, degree), Space(merged, degree)
    leaf, node = before.example.T
    found, _ = before.directory.lookup(after.keys, values[leaf, node], np.ones(len(before), dtype=bool))
    return found[after.cells]
