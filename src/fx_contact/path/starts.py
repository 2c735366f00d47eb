"""States from which the points of a load path begin."""

import numpy as np
from mpi4py import MPI

from fx_contact.adaptive.state import State
from fx_contact.adaptive.step_solver import HISTORY
from fx_contact.parallel.arrays import FloatArray, Int8Array
from fx_contact.scene.fingerprint import same_mesh
from fx_contact.scene.scene import Scene

#: Field with the last displacement of a load path that is repeated.
COMPARED = "compared"


def at_rest(last: State) -> State:
    """Zero displacement on the forest of a state, whose displacement is the field `COMPARED`.  Local."""
    displacement = last.fields["displacement"]
    fields = last.fields.with_field(COMPARED, displacement).without(HISTORY)
    return State(fields.with_field("displacement", np.zeros_like(displacement)), last.motions, 1.0)


def same_root(state: State, scene: Scene) -> bool:
    """True if a state is on the root mesh of a scene, with its contact pairs, and forces on the same obstacles.

    Local.
    """
    forest, known = state.forest, state.motions or {}
    if any((pair.motion is not None) != (pair.name in known) for pair in scene.contact):
        return False
    return same_mesh(forest.mesh, scene.mesh) and forest.stands_on(scene.pairing, scene.contact_surfaces)


def next_increment(state: State) -> State:
    """The state from which the next increment begins: its displacement is history and a first guess.  Local."""
    fields = state.fields.with_field(HISTORY, state.fields["displacement"])
    return State(fields, state.motions, 1.0, moved=state.moved)


def carried_over(state: State, tolerance: float, kind: str) -> State:
    """The state on a coarsened forest, its displacement a first guess.

    Collective on state.forest.comm.  Criterion (2) refines cells with an error above e omega / sqrt(N).  A leaf merges
    with its siblings if two refinements of the parent, the most of one marking, are expected to lead to at most this
    error (smooth solution).  A run then has two meshes as a rule.

    Args:
        tolerance: prescribed accuracy e [-].
        kind: of partition, a key of `partition.KINDS`.
    """
    forest, estimate = state.forest, state.estimate
    assert estimate is not None, "of a solved state"
    allowed = (tolerance * estimate.energy_norm) ** 2 / estimate.cells
    merges = _merges(estimate.error**2, allowed / estimate.child_error**2, estimate.child_error, forest.level)
    fields = state.fields
    if forest.comm.allreduce(bool(merges.any()), op=MPI.LOR):
        fields = fields.coarsened(forest.level - merges, kind)
    return State(fields, state.motions, 1.0)


def _merges(error2: FloatArray, allowed: float, child_error: float, level: Int8Array) -> Int8Array:
    """Merges (n,) of leaves: xi_T^2 of the ancestor k levels above, child_error^(-k) times theirs, is allowed."""
    ancestors = np.arange(1, int(level.max(initial=0)) + 1)
    small = error2[:, None] <= allowed * child_error**ancestors
    return np.minimum(small.sum(axis=1), level).astype(np.int8)
