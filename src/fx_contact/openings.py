"""Where open contact may close: places at which strains have moved surfaces by much of what is left between them."""

import numpy as np
from mpi4py import MPI

#: Parts of the longest side of a contact pair's bounding box, by which places are told apart,
_PARTS = 2
#: and where their bounds are, relative to such a part: halved cells have no vertices there.
_BOUND = 0.3
#: Parts of the same bodies whose greatest ratios of movement to what is left differ by no more are one place.
_ALIKE = 2.0
#: Movement of a place, relative to what is left there, from which a contact pair that has a force is asked for it.
_MUCH = 0.05
#: Gaps up to this part of what they have changed by are rounding.
_CLOSED = 1e-6


def moved_by_strains(scene, pairs, penetration):
    """How far strains have moved the surfaces of pairs towards each other, or apart.

    Collective.  It is what they have moved less the rigid motions of the bodies: those that conditions prescribe, and
    of those that no condition stops the ones that explain most of the rest.

    Args:
        scene: Scene.
        pairs: NodePairs.
        penetration: (n,) float64 [m].

    Returns:
        (n,) float64 [m].
    """
    here, there = (scene.rigid_motions(pairs.position, side, pairs.normal) for side in pairs.bodies.T)
    rigid = here - there
    moved = penetration + pairs.gap - rigid @ scene.prescribed_motion
    if len(scene.free_motions):
        free = rigid @ scene.free_motions.reshape(len(scene.free_motions), -1).T
        weighted = pairs.area * free.T
        sums = np.column_stack([weighted @ free, weighted @ moved])
        pairs.prolongation.comm.Allreduce(MPI.IN_PLACE, sums)
        motion, *_ = np.linalg.lstsq(sums[:, :-1], sums[:, -1], rcond=1e-10)
        moved -= free @ motion
    return moved


def openings(index, pairs, contact, moved, around, presses):
    """The open places of a contact pair, each by its nodes for which strains have done most for what is left.

    Collective.  A gap that is least where nothing moves tells nothing.

    Args:
        index: of the contact pair.
        pairs: NodePairs.
        contact: ContactSolution.
        moved: (n,) float64, as from `moved_by_strains` [m].
        around: (n,) bool, pairs that belong to closed contact next to them.
        presses: whether the contact pair has a force: then places that have moved little are left out.

    Returns:
        (k, n) float64, for each place the parts of its area that the pairs have [-].
    """
    comm, ours = pairs.prolongation.comm, np.flatnonzero(pairs.contact == index)
    left, changed = np.maximum(-contact.penetration, 0.0), np.abs(pairs.gap + contact.penetration)
    ratio = np.abs(moved) / np.maximum(left, _CLOSED * changed + np.finfo(float).tiny)
    ratio = np.where(around | contact.active, 0.0, ratio)[ours]

    position, bodies = pairs.position[ours], pairs.bodies[ours]
    ends = np.stack([position.min(axis=0, initial=np.inf), (-position).min(axis=0, initial=np.inf)])
    comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MIN)
    side = max((-ends[1] - ends[0]).max(), np.finfo(float).tiny) / _PARTS
    row = np.column_stack([bodies, np.floor((position - ends[0]) / side + _BOUND).astype(np.int64)])
    parts = np.unique(np.concatenate(comm.allgather(np.unique(row, axis=0))), axis=0)
    part = np.unique(np.concatenate([parts, row]), axis=0, return_inverse=True)[1].ravel()[len(parts) :]
    most = np.zeros(len(parts))
    np.maximum.at(most, part, ratio)
    comm.Allreduce(MPI.IN_PLACE, most, op=MPI.MAX)

    place = _joined(parts[:, :2], most)[part]
    least = _MUCH if presses else min(_MUCH, most.max())
    there = (ratio >= most[place] / _ALIKE) & (ratio > 0) & (most[place] >= least)
    area = np.bincount(place, there * pairs.area[ours], len(parts)).astype(float)
    comm.Allreduce(MPI.IN_PLACE, area)
    weights = np.zeros((np.count_nonzero(area), len(pairs)))
    for weight, one in zip(weights, np.flatnonzero(area)):
        some = there & (place == one)
        weight[ours[some]] = pairs.area[ours[some]] / area[one]
    return weights


def _joined(bodies, most):
    """The part with the greatest ratio of those that each part is one place with: (n,) int.

    Args:
        bodies: (n, 2) int, the bodies of each part.
        most: (n,) float64, the greatest ratio of each.
    """
    head = np.full(len(most), -1)
    for first in np.argsort(-most, kind="stable"):
        same = (bodies == bodies[first]).all(axis=1) & (_ALIKE * most >= most[first])
        head[(head < 0) & (head[first] < 0) & same] = first
    return head
