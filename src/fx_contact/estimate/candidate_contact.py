"""Where open contact may close: places at which strains have moved surfaces by much of what is left between them."""

import numpy as np
from mpi4py import MPI

#: Parts of the longest side of the box around a connected surface of two bodies, by which places are told apart,
_PARTS = 2
#: and where their bounds are, relative to such a part: halved cells have no vertices there.
_BOUND = 0.3
#: Gaps up to this part of what they have changed by are rounding.
_CLOSED = 1e-6


def moved_by_strains(scene, pairs, contact):
    """How far strains have moved the surfaces of pairs towards each other, or apart.

    Collective.  It is what they have moved less the rigid motions of the bodies: those that conditions prescribe, and
    of those that no condition stops the ones that bring closed contact together.

    Args:
        scene: Scene.
        pairs: NodePairs.
        contact: ContactSolution.

    Returns:
        (n,) float64 [m].
    """
    moved, sides = contact.penetration + pairs.gap, list(zip((1, -1), pairs.bodies.T))
    for sign, side in sides:
        modes = np.einsum("nmi,ni->nm", scene.rigid_modes(pairs.position, side), pairs.normal)
        moved -= sign * (modes * scene.prescribed_motion[side]).sum(axis=1)
    if len(scene.free_motions):
        free = sum(sign * scene.motion(pairs.position, side, pairs.normal) for sign, side in sides)
        weighted = contact.active * pairs.area * free.T
        sums = np.column_stack([weighted @ free, weighted @ moved])
        pairs.prolongation.comm.Allreduce(MPI.IN_PLACE, sums)
        motion, *_ = np.linalg.lstsq(sums[:, :-1], sums[:, -1], rcond=1e-10)
        moved -= free @ motion
    return moved


def openings(index, pairs, contact, moved, surface, around, control):
    """The open places of a contact pair, each by its nodes for which strains have done most for what is left.

    Collective.  A gap that is least where nothing moves tells nothing.  What is not connected is not one place.

    Args:
        index: of the contact pair.
        pairs: NodePairs.
        contact: ContactSolution.
        moved: (n,) float64, as from `moved_by_strains` [m].
        surface: (n,) int, which connected surface each pair is on.
        around: (n,) bool, pairs that belong to closed contact next to them.
        control: ErrorControl.

    Returns:
        (k, n) float64, for each place the parts of its area that the pairs have [-].
    """
    comm, ours = pairs.prolongation.comm, np.flatnonzero(pairs.contact == index)
    left, changed = np.maximum(-contact.penetration, 0.0), np.abs(pairs.gap + contact.penetration)
    ratio = np.abs(moved) / np.maximum(left, _CLOSED * np.maximum(changed, np.abs(moved)) + np.finfo(float).tiny)
    ratio = np.where(around | contact.active, 0.0, ratio)[ours]

    position = pairs.position[ours]
    sides, which = _numbered(np.column_stack([surface, pairs.bodies])[ours], comm)
    ends = np.full((2, len(sides), 3), np.inf)
    np.minimum.at(ends, (0, which), position)
    np.minimum.at(ends, (1, which), -position)
    comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MIN)
    size = np.maximum((-ends[1] - ends[0]).max(axis=1), np.finfo(float).tiny) / _PARTS
    grid = np.floor((position - ends[0, which]) / size[which, None] + _BOUND).astype(np.int64)
    parts, part = _numbered(np.column_stack([which, grid]), comm)
    most = np.zeros(len(parts))
    np.maximum.at(most, part, ratio)
    comm.Allreduce(MPI.IN_PLACE, most, op=MPI.MAX)

    place = _joined(parts[:, 0], most, control.candidate_spread)[part]
    # Of each surface whether it is closed somewhere, and its greatest ratio.
    state = np.zeros((2, len(sides)))
    np.maximum.at(state, (0, which), contact.active[ours])
    np.maximum.at(state, (1, which), ratio)
    comm.Allreduce(MPI.IN_PLACE, state, op=MPI.MAX)
    least = np.where(state[0], control.candidate_movement, np.minimum(state[1], control.candidate_movement))[which]
    there = (ratio >= most[place] / control.candidate_spread) & (ratio > 0) & (most[place] >= least)
    area = np.bincount(place, there * pairs.area[ours], len(parts)).astype(float)
    comm.Allreduce(MPI.IN_PLACE, area)
    weights = np.zeros((np.count_nonzero(area), len(pairs)))
    for weight, one in zip(weights, np.flatnonzero(area)):
        some = there & (place == one)
        weight[ours[some]] = pairs.area[ours[some]] / area[one]
    return weights


def _numbered(rows, comm):
    """The distinct rows of integers of all ranks, and which of them each row is."""
    distinct = np.unique(np.concatenate(comm.allgather(np.unique(rows, axis=0))), axis=0)
    _, which = np.unique(np.concatenate([distinct, rows]), axis=0, return_inverse=True)
    return distinct, which.ravel()[len(distinct) :]


def _joined(surface, most, spread):
    """The part with the greatest ratio of those that each part is one place with: (n,) int.

    Args:
        surface: (n,) int, which connected surface of two bodies each part is of.
        most: (n,) float64, the greatest ratio of each.
        spread: factor by which ratios of one place may differ [-].
    """
    head = np.full(len(most), -1)
    for first in np.argsort(-most, kind="stable"):
        same = (surface == surface[first]) & (spread * most >= most[first])
        head[(head < 0) & (head[first] < 0) & same] = first
    return head
