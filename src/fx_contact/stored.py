"""The energy that contact forces store, which the tolerance of each contact is relative to."""

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from fx_contact.estimate import VOIGT

#: Around a contact is what is no farther than so many times the root of its area: nearly all of a half-space's energy.
_AROUND = 3.0
#: So many times the energy of the stress along the contact's normal is all of a half-space's, and more than a plate's.
#: In rings that are shrunk on each other, which hoop stresses fill, it is a seventh: they are refined for less.
_OF_NORMAL = 1.5
#: Parts of the longest side of a contact's bounding box, by which its pairs are told apart.
_PARTS = 16


def stored_by_forces(forest, elasticity, poisson, estimate, pairs, force, group, count):
    """The energy that the forces of groups of node pairs store, about.

    Collective on forest.comm.  A punch with the force F and the area A stores F^2 / (E* A^(1/2)) in a half-space.  In
    bodies that are stiffer, like thin plates, it is less: no more than there is in the contact's bodies next to it,
    nearer than to others, and of that no more than a stress along its normal has, as far as its own pressure can cause
    that: in a half-space, F 3 z^3 / (2 pi R^5) at the depth z, the distance R from all of it (Boussinesq).  What other
    loads store is no measure of contact.

    Args:
        forest: Forest.
        elasticity: Elasticity.
        poisson: (nbodies,) float64 [-].
        estimate: Estimate.
        pairs: NodePairs.
        force: (n,) float64, compression positive [N].
        group: (n,) int, the group of each pair that presses.
        count: number of groups on all ranks.

    Returns:
        (count,) float64, twice the energy of each group [J].
    """
    body, leaves = forest.mesh.body[forest.cell], np.arange(len(forest))
    energy = np.empty(len(forest))
    energy[elasticity.leaf_mesh.leaf] = estimate.energy
    stress = _stress(forest, elasticity, estimate)
    square, trace = np.einsum("nij,nij->n", stress, stress), np.trace(stress, axis1=1, axis2=2)
    density = (1 + poisson[body]) * square - poisson[body] * trace**2  # of energy, times Young's modulus
    half = np.linalg.norm(forest.positions(leaves, 0) - forest.centres, axis=1)

    total, approach = pairs.pressing(force, group, count)
    places, around = _Places(pairs, force, group, count), np.zeros(count)
    for one in np.unique(places.body):
        leaf, place = np.flatnonzero(body == one), np.flatnonzero(places.body == one)
        distance, nearest = cKDTree(places.position[place]).query(forest.centres[leaf])
        near = distance <= places.radius[places.group[place[nearest]]] + half[leaf]
        leaf, place = leaf[near], place[nearest[near]]
        along = np.einsum("ni,nij,nj->n", places.normal[place], stress[leaf], places.normal[place]) ** 2
        possible = places.stress(place, forest.centres[leaf], half[leaf]) ** 2
        share = _OF_NORMAL * _quotient(along, density[leaf]) * _quotient(possible, along)
        around += np.bincount(places.group[place], np.minimum(share, 1.0) * energy[leaf], count)
    return np.minimum(total * approach, forest.comm.allreduce(around))


def _stress(forest, elasticity, estimate):
    """Means of the recovered stress in this rank's leaves: (n, 3, 3) float64 [Pa]."""
    nodal, stress = np.empty((len(forest.vertices), 6)), np.empty((len(forest), 3, 3))
    nodal[elasticity.vertex_of_block] = estimate.stress.x.array.reshape(-1, 6)
    for component, (i, j) in enumerate(VOIGT):
        stress[:, i, j] = stress[:, j, i] = nodal[forest.vertices.cells, component].mean(axis=1)
    return stress


def _quotient(part, whole):
    """The quotient of two non-negative arrays, at most 1, also where both are 0."""
    return np.divide(part, whole, out=np.ones(len(part)), where=part < whole)


class _Places:
    """Where groups of pairs press, on both bodies: pairs that are close to each other are one place.

    Collective on the pairs' communicator.  All ranks have all places, a few hundred for each group.

    Args:
        pairs: NodePairs.
        force: (n,) float64, compression positive [N].
        group: (n,) int, the group of each pair that presses.
        count: number of groups on all ranks.

    Attributes:
        radius: (count,) float64, how far around each group is [m].
        group, body: (k,) int, those of each place.
        position, normal: (k, 3) float64, undeformed [m], and along the contact.
    """

    def __init__(self, pairs, force, group, count):
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
        decay = _quotient(3 / (2 * np.pi) * self._area[group] * depth**3, distance2**2.5)
        return decay * self._pressure[group]


def _added(key, values):
    """Distinct rows of integers, and the sums of the values of equal ones."""
    key, which = np.unique(key, axis=0, return_inverse=True)
    sums = np.zeros((len(key), values.shape[1]))
    np.add.at(sums, which.ravel(), values)
    return key, sums
