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


class StoredEnergy:
    """Energy and error of this rank's leaves, and what of the energy the forces of groups of node pairs store.

    Collective on forest.comm.  A punch with the force F and the area A stores F^2 / (E* A^(1/2)) in a half-space.  In
    bodies that are stiffer, like thin plates, it is less: no more than there is in the contact's bodies next to it,
    nearer than to others, and of that no more than a stress along its normal has.  What loads on other bodies, or
    across the normal, store is no measure of contact; one along the normal, next to it, is not told apart.

    Args:
        forest: Forest.
        elasticity: Elasticity.
        poisson: (nbodies,) float64 [-].
        estimate: Estimate.
    """

    def __init__(self, forest, elasticity, poisson, estimate):
        self._forest, self._body = forest, forest.mesh.body[forest.cell]
        self._energy, self._error = np.empty((2, len(forest)))
        self._energy[elasticity.leaf_mesh.leaf], self._error[elasticity.leaf_mesh.leaf] = (
            estimate.energy,
            estimate.error,
        )
        stress = np.empty((len(forest.vertices), 6))
        stress[elasticity.vertex_of_block] = estimate.stress.x.array.reshape(-1, 6)
        stress = stress[forest.vertices.cells].mean(axis=1)
        self._stress = np.empty((len(forest), 3, 3))
        for component, (i, j) in enumerate(VOIGT):
            self._stress[:, i, j] = self._stress[:, j, i] = stress[:, component]
        square, trace = np.einsum("nij,nij->n", self._stress, self._stress), np.trace(self._stress, axis1=1, axis2=2)
        self._density = (1 + poisson[self._body]) * square - poisson[self._body] * trace**2  # of energy
        self._half = np.linalg.norm(forest.positions(np.arange(len(forest)), 0) - forest.centres, axis=1)

    def of_forces(self, pairs, force, group, count):
        """Twice the energy that the forces of groups of pairs store, about, and the estimated error next to them.

        Collective on forest.comm.

        Args:
            pairs: NodePairs.
            force: (n,) float64, compression positive [N].
            group: (n,) int, the group of each pair that presses.
            count: number of groups on all ranks.

        Returns:
            two (count,) float64: the energy [J], and the square of the error [J].
        """
        total, approach = pairs.pressing(force, group, count)
        radius, owner, bodies, position, normal = _places(pairs, force > 0, group, count)
        around = np.zeros((3, count))
        for body in np.unique(bodies):
            leaf, place = np.flatnonzero(self._body == body), np.flatnonzero(bodies == body)
            distance, nearest = cKDTree(position[place]).query(self._forest.centres[leaf])
            near = distance <= radius[owner[place[nearest]]] + self._half[leaf]
            leaf, place = leaf[near], place[nearest[near]]
            along = np.einsum("ni,nij,nj->n", normal[place], self._stress[leaf], normal[place]) ** 2
            share = np.divide(along, self._density[leaf], out=np.zeros(len(leaf)), where=along < self._density[leaf])
            share[along >= self._density[leaf]] = 1.0
            np.add.at(around, (0, owner[place]), self._energy[leaf])
            np.add.at(around, (1, owner[place]), _OF_NORMAL * share * self._energy[leaf])
            np.add.at(around, (2, owner[place]), self._error[leaf] ** 2)
        self._forest.comm.Allreduce(MPI.IN_PLACE, around)
        return np.minimum(total * approach, around[:2].min(axis=0)), around[2]


def _places(pairs, presses, group, count):
    """Where groups press, on both bodies, with pairs that are close to each other taken together.

    Returns:
        (count,) float64, how far around is [m]; of k places the group and the body, (k,) int, the undeformed position
        (k, 3) [m] and the normal (k, 3).
    """
    comm, area, normal = pairs.prolongation.comm, pairs.area[presses], pairs.normal[presses]
    whole = np.bincount(group[presses], area, count).astype(float)
    comm.Allreduce(MPI.IN_PLACE, whole)
    across = pairs.position[presses] + pairs.gap[presses, None] * normal
    position = np.concatenate([pairs.position[presses], across])
    surface = np.concatenate([2 * group[presses], 2 * group[presses] + 1])
    body = pairs.bodies[presses].T.ravel()
    ends = np.full((2, 2 * count, 3), np.inf)
    np.minimum.at(ends, (0, surface), position)
    np.minimum.at(ends, (1, surface), -position)
    comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MIN)

    side = np.maximum((-ends[1] - ends[0]).max(axis=1), np.finfo(float).tiny) / _PARTS
    bins = np.floor((position - ends[0, surface]) / side[surface, None]).astype(np.int64)
    area, normal = np.tile(area, 2), np.tile(normal, (2, 1))
    key = np.column_stack([surface, body, bins])
    key, sums = _added(key, np.column_stack([area, area[:, None] * position, area[:, None] * normal]))
    key, sums = _added(*map(np.concatenate, zip(*comm.allgather((key, sums)))))
    normal = sums[:, 4:] / np.maximum(np.linalg.norm(sums[:, 4:], axis=1), np.finfo(float).tiny)[:, None]
    radius = _AROUND * np.sqrt(pairs.symmetry * whole)
    return radius, key[:, 0] // 2, key[:, 1], sums[:, 1:4] / sums[:, :1], normal


def _added(key, values):
    """Distinct rows of integers, and the sums of the values of equal ones."""
    key, which = np.unique(key, axis=0, return_inverse=True)
    sums = np.zeros((len(key), values.shape[1]))
    np.add.at(sums, which.ravel(), values)
    return key, sums
