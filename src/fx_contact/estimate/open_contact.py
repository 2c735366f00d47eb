"""Open contact pairs: where they may close, by how far strains have moved their surfaces towards each other."""

import numpy as np
from mpi4py import MPI

#: Gaps up to this part of what they have changed by are rounding.
_CLOSED = 1e-6
#: Node pairs whose ratio of movement to gap is this part of the largest are one place.
_PLACE = 0.5


def nearest_place(state, index):
    """The place of a contact pair that is nearest to closing: the node pairs with the largest ratio of movement to gap.

    Collective on state.forest.comm.  The ratio counts, not the gap, which may be least where nothing moves.

    Args:
        state: SolvedState.
        index: of the contact pair.

    Returns:
        (n,) float64, the part of the place's area that each node pair has [-]; None: nothing moves.
    """
    comm, pairs, solution, moved = state.forest.comm, state.pairs, state.solution, np.abs(moved_by_strains(state))
    left, changed = np.maximum(-solution.penetration, 0.0), np.abs(pairs.gap + solution.penetration)
    rounding = _CLOSED * np.maximum(changed, moved) + np.finfo(float).tiny
    ratio = np.where(pairs.contact == index, moved / np.maximum(left, rounding), 0.0)
    largest = comm.allreduce(float(ratio.max(initial=0.0)), op=MPI.MAX)
    if not largest:
        return None
    area = np.where(ratio >= _PLACE * largest, pairs.area, 0.0)
    return area / comm.allreduce(float(area.sum()))


def moved_by_strains(state):
    """How far strains have moved the surfaces of node pairs towards each other.

    Collective.  It is B u less the rigid motions of the bodies: those that conditions prescribe, and of those that no
    condition stops the ones that bring closed contact together.

    Args:
        state: SolvedState.

    Returns:
        (n,) float64 [m].
    """
    scene, pairs, solution = state.scene, state.pairs, state.solution
    moved, sides = solution.penetration + pairs.gap, list(zip((1, -1), pairs.bodies.T))
    for sign, side in sides:
        modes = np.einsum("nmi,ni->nm", scene.rigid_motions.modes(pairs.position, side), pairs.normal)
        moved -= sign * (modes * scene.rigid_motions.prescribed[side]).sum(axis=1)
    if len(scene.rigid_motions.free):
        free = sum(sign * scene.rigid_motions.free_along(pairs.position, side, pairs.normal) for sign, side in sides)
        weighted = solution.active * pairs.area * free.T
        sums = np.column_stack([weighted @ free, weighted @ moved])
        pairs.prolongation.comm.Allreduce(MPI.IN_PLACE, sums)
        motion, *_ = np.linalg.lstsq(sums[:, :-1], sums[:, -1], rcond=1e-10)  # as RigidMotions tells free from held
        moved -= free @ motion
    return moved
