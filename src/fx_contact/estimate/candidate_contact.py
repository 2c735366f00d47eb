"""Candidate contact zones: places on open surfaces where strains have taken up much of the gap that was left."""

import numpy as np
from mpi4py import MPI

from fx_contact.contact.contact_patches import ContactPatches
from fx_contact.estimate.point_groups import bounding_boxes, distinct_rows

#: Parts of the longest side of the box around a connected surface of two bodies, by which places are told apart,
_PARTS = 2
#: and where their bounds are, relative to such a part: halved cells have no vertices there.
_BOUND = 0.3
#: Gaps up to this part of what they have changed by are rounding.
_CLOSED = 1e-6


class CandidateZones:
    """The candidate contact zones of a step.

    Collective on state.forest.comm.

    Args:
        state: SolvedState.
        patches: ContactPatches of the closed pairs.
        clusters: PressureClusters of these.
        control: ErrorControl.
    """

    def __init__(self, state, patches, clusters, control):
        self._state, self._patches, self._clusters, self._control = state, patches, clusters, control
        self._moved = moved_by_strains(state)
        everything = np.ones(len(state.pairs), dtype=bool)
        self._surface = ContactPatches(state.forest, state.pairs, everything).pair

    def places(self, index):
        """The candidate places of a contact pair, each by its node pairs with the largest ratio of movement to gap.

        Collective.  The ratio counts, not the gap, which may be least where nothing moves.  The parts of a connected
        surface are one place where their largest ratios differ by less than `candidate_spread`.

        Args:
            index: of the contact pair.

        Returns:
            (k, n) float64, for each place the parts of its area that the node pairs have [-].
        """
        pairs, active, control = self._state.pairs, self._state.solution.active, self._control
        comm, ours = pairs.prolongation.comm, np.flatnonzero(pairs.contact == index)
        ratio, position = self._ratio(index)[ours], pairs.position[ours]

        surfaces, surface = distinct_rows(comm, np.column_stack([self._surface, pairs.bodies])[ours])
        low, length = bounding_boxes(comm, position, surface, len(surfaces))
        cells = np.floor((position - low[surface]) / (length / _PARTS)[surface, None] + _BOUND).astype(np.int64)
        parts, part = distinct_rows(comm, np.column_stack([surface, cells]))
        largest = np.zeros(len(parts))
        np.maximum.at(largest, part, ratio)
        comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
        place = _leading_part(parts[:, 0], largest, control.candidate_spread)[part]

        # Of each surface whether it is closed somewhere, and its largest ratio: an open one always has a place.
        state = np.zeros((2, len(surfaces)))
        np.maximum.at(state, (0, surface), active[ours])
        np.maximum.at(state, (1, surface), ratio)
        comm.Allreduce(MPI.IN_PLACE, state, op=MPI.MAX)
        least = control.candidate_movement
        least = np.where(state[0], least, np.minimum(state[1], least))[surface]
        there = (ratio >= largest[place] / control.candidate_spread) & (ratio > 0) & (largest[place] >= least)
        area = np.bincount(place, there * pairs.area[ours], len(parts)).astype(float)
        comm.Allreduce(MPI.IN_PLACE, area)
        weights = np.zeros((np.count_nonzero(area), len(pairs)))
        for weight, one in zip(weights, np.flatnonzero(area)):
            some = there & (place == one)
            weight[ours[some]] = pairs.area[ours[some]] / area[one]
        return weights

    def _ratio(self, index):
        """Movement over the gap left, (n,) float64; 0 at closed contact of the contact pair and around it."""
        pairs, solution, moved = self._state.pairs, self._state.solution, np.abs(self._moved)
        left, changed = np.maximum(-solution.penetration, 0.0), np.abs(pairs.gap + solution.penetration)
        rounding = _CLOSED * np.maximum(changed, moved) + np.finfo(float).tiny
        around = self._clusters.around(pairs, self._patches.contact == index)
        return np.where(around | solution.active, 0.0, moved / np.maximum(left, rounding))


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


def _leading_part(surface, largest, spread):
    """The part with the largest ratio of those that each part is one place with: (n,) int.

    Args:
        surface: (n,) int, which connected surface of two bodies each part is of.
        largest: (n,) float64, the largest ratio of each.
        spread: factor by which the ratios of one place may differ [-].
    """
    head = np.full(len(largest), -1)
    for first in np.argsort(-largest, kind="stable"):
        same = (surface == surface[first]) & (spread * largest >= largest[first])
        head[(head < 0) & (head[first] < 0) & same] = first
    return head
