"""A solved step as the beginning of a run of another scene on the same root mesh."""

import numpy as np
from mpi4py import MPI

from fx_contact.adaptive.beginning import Beginning
from fx_contact.estimate.effectivity import RefinementHistory
from fx_contact.fem.space import Space
from fx_contact.forest.coarsening import coarsened
from fx_contact.problem import hexahedron


def carried_over(state, tolerance, control, kind, coarse):
    """The forest of a state with leaves merged, and its displacement there, a first guess.

    Collective on state.forest.comm.  A leaf merges with its siblings while their parent, where the solution is smooth,
    has at most an error tau / sqrt(N).  Criterion (2) refines cells above e omega / sqrt(N).

    - Kept: N / 8 such parents leave the present solution the error that a last refinement aims at, `control.target` of
      what is allowed; the rest is for what the next scene changes.  The measured effectivity counts.
    - Coarse: tau is e omega times what two refinements divide the error of a cell by, as many as one marking can do.  A
      point begun so has at least two meshes, and measures the effectivity itself.

    Args:
        state: State of the last step.
        tolerance: prescribed accuracy e [-].
        control: ErrorControl.
        kind: of partition, a key of `partition.KINDS`.
        coarse: whether the forest is to be coarse; else it is kept.

    Returns:
        Beginning.
    """
    forest, estimate, theta = state.forest, state.estimate, state.history.effectivity
    allowed = (control.correction(state.history) * tolerance * estimate.energy_norm) ** 2
    if coarse:
        tau2, history = allowed / estimate.child_error**2, RefinementHistory(theta)
    else:
        left = max(control.target**2 * allowed - estimate.error_global**2, 0.0)
        tau2, history = 8 * left, RefinementHistory(theta, compared=True)
    merges = _merges(estimate.error**2, tau2 / estimate.cells, estimate.child_error, forest.level)
    if not forest.comm.allreduce(bool(merges.any()), op=MPI.LOR):
        return Beginning(forest, state.values, history)
    merged = coarsened(forest, forest.level - merges, kind)
    return Beginning(merged, _on_nodes(forest, state.values, merged), history)


def _merges(error2, allowed, child_error, level):
    """How often each leaf may merge: xi_T^2 of its ancestor k levels above is child_error^(-k) times its own.

    Args:
        error2: (n,) float64, xi_T^2 of the leaves [J].
        allowed: tau^2 of an ancestor [J].
        child_error: xi_T^2 of a child over that of its parent [-].
        level: (n,) int8, of the leaves.

    Returns:
        (n,) int8.
    """
    ancestors = np.arange(1, int(level.max(initial=0)) + 1)
    small = error2[:, None] <= allowed * child_error**ancestors
    return np.minimum(small.sum(axis=1), level).astype(np.int8)


def _on_nodes(forest, values, merged):
    """Nodal values on a coarser forest, whose nodes are nodes of the finer one.  Collective.

    Args:
        forest: Forest.
        values: (n, (p+1)^3, k) float64 at the nodes of its leaves.
        merged: Forest, nowhere finer.

    Returns:
        (m, (p+1)^3, k) float64.
    """
    degree = hexahedron.order_of(values.shape[1])
    before, after = Space(forest, degree), Space(merged, degree)
    leaf, node = before.example.T
    found, _ = before.directory.lookup(after.keys, values[leaf, node], np.ones(len(before), dtype=bool))
    return found[after.cells]
