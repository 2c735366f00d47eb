"""Where contacts press, and what their pressure can reach."""

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

#: Around a contact is what is no farther than so many times the root of its area: nearly all of a half-space's energy.
_AROUND = 3.0
#: Parts of the longest side of a contact's bounding box, by which its pairs are told apart.
_PARTS = 16


class Places:
    """Where groups of pairs press, on both bodies: pairs that are close to each other are one place.

    Collective on the pairs' communicator.  All ranks have all places, a few hundred for each group.

    Args:
        pairs: NodePairs.
        force: (n,) float64, compression positive [N].
        group: (n,) int, the group of each pair that presses.
        count: number of groups on all ranks.

    Attributes:
        force, approach: (count,) float64, as from `NodePairs.pressing` [N], [m].
        radius: (count,) float64, how far around each group is [m].
        group, body: (k,) int, those of each place.
        position, normal: (k, 3) float64, undeformed [m], and along the contact.
    """

    def __init__(self, pairs, force, group, count):
        self.force, self.approach = pairs.pressing(force, group, count)
        comm, presses = pairs.prolongation.comm, force > 0
        group, area, normal = group[presses], pairs.area[presses], pairs.normal[presses]
        self._pressure, whole = np.zeros(count), np.bincount(group, area, count).astype(float)
        np.maximum.at(self._pressure, group, force[presses] / area)
        comm.Allreduce(MPI.IN_PLACE, self._pressure, op=MPI.MAX)
        comm.Allreduce(MPI.IN_PLACE, whole)
        self._area = pairs.symmetry * whole
        self.radius = _AROUND * np.sqrt(self._area)

        across = pairs.position[presses] + pairs.gap[presses, None] * normal
        position = np.concatenate([pairs.position[presses], across])
        surface = np.concatenate([2 * group, 2 * group + 1])
        ends = np.full((2, 2 * count, 3), np.inf)
        np.minimum.at(ends, (0, surface), position)
        np.minimum.at(ends, (1, surface), -position)
        comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MIN)
        side = np.maximum((-ends[1] - ends[0]).max(axis=1), np.finfo(float).tiny) / _PARTS
        bins = np.floor((position - ends[0, surface]) / side[surface, None]).astype(np.int64)
        area, normal = np.tile(area, 2), np.tile(normal, (2, 1))
        key = np.column_stack([surface, pairs.bodies[presses].T.ravel(), bins])
        key, sums = _added(key, np.column_stack([area, area[:, None] * position, area[:, None] * normal]))
        key, sums = _added(*map(np.concatenate, zip(*comm.allgather((key, sums)))))
        self.group, self.body, self._side = key[:, 0] // 2, key[:, 1], side[key[:, 0]]
        self.position, self.normal = sums[:, 1:4] / sums[:, :1], sums[:, 4:]
        self.normal /= np.maximum(np.linalg.norm(self.normal, axis=1, keepdims=True), np.finfo(float).tiny)

    def stress(self, place, points, size):
        """The most stress along normals that the pressure of groups causes in half-spaces: (n,) float64 [Pa].

        Local.

        Args:
            place: (n,) int, the place nearest to each point.
            points: (n, 3) float64 [m].
            size: (n,) float64, half of what points stand for across [m].
        """
        group, offset = self.group[place], points - self.position[place]
        depth = np.abs(np.einsum("ni,ni->n", offset, self.normal[place]))
        aside = np.sqrt(np.maximum((offset**2).sum(axis=1) - depth**2, 0.0)) - size - self._side[place]
        distance2 = depth**2 + np.maximum(aside, 0.0) ** 2
        decay = at_most_one(3 / (2 * np.pi) * self._area[group] * depth**3, distance2**2.5)
        return decay * self._pressure[group]

    def around(self, pairs, groups):
        """Which pairs are, on both of their bodies, around a contact of some groups: (n,) bool.

        Local.

        Args:
            pairs: NodePairs.
            groups: (count,) bool.
        """
        ends = pairs.position, pairs.position + pairs.gap[:, None] * pairs.normal
        return np.logical_and(*(self._near(*end, groups) for end in zip(ends, pairs.bodies.T)))

    def _near(self, points, bodies, groups):
        """Which points of bodies are around a place of some groups on the same body: (n,) bool."""
        near = np.zeros(len(points), dtype=bool)
        for body in np.unique(bodies):
            point, place = np.flatnonzero(bodies == body), np.flatnonzero(groups[self.group] & (self.body == body))
            if len(place):
                distance, nearest = cKDTree(self.position[place]).query(points[point])
                near[point] = distance <= self.radius[self.group[place[nearest]]]
        return near


def _added(key, values):
    """Distinct rows of integers, and the sums of the values of equal ones."""
    key, which = np.unique(key, axis=0, return_inverse=True)
    sums = np.zeros((len(key), values.shape[1]))
    np.add.at(sums, which.ravel(), values)
    return key, sums


def at_most_one(part, whole):
    """The quotient of two non-negative arrays, at most 1, also where both are 0."""
    return np.divide(part, whole, out=np.ones(len(part)), where=part < whole)
