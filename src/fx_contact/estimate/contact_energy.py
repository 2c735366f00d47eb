"""The energy that the forces of contact patches store, to which the tolerance of each patch is relative."""

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from fx_contact.estimate.point_groups import bounding_boxes, sums_by_row
from fx_contact.estimate.recovery import VOIGT

#: The radius of the zone around a patch, over the root of its area: nearly all of a half-space's energy is inside.
_ZONE = 3.0
#: Parts of the longest side of a patch's bounding box, by which its node pairs are clustered.
_PARTS = 16
#: Times the energy of the stress along the contact's normal there is at most: 1.5 is all of a half-space's, and more
#: than a plate's.  In rings that are shrunk on each other, which hoop stresses fill, it is a seventh: they are refined
#: for less.
_OF_NORMAL = 1.5


class PressureClusters:
    """The node pairs of contact patches under pressure, clustered on both bodies.

    Collective on the pairs' communicator.  All ranks have all clusters, a few hundred for each patch.

    Args:
        pairs: NodePairs.
        force: (n,) float64, compression positive [N].
        patch: (n,) int, the patch of each pair under pressure.
        count: number of patches on all ranks.

    Attributes:
        force, approach: (count,) float64, of each patch as from `NodePairs.pressing` [N], [m].
        radius: (count,) float64, of the zone around each patch [m].
        patch, body: (k,) int, those of each cluster.
        position, normal: (k, 3) float64, undeformed [m], and along the contact.
    """

    def __init__(self, pairs, force, patch, count):
        self.force, self.approach = pairs.pressing(force, patch, count)
        comm, presses = pairs.prolongation.comm, force > 0
        patch, area, normal = patch[presses], pairs.area[presses], pairs.normal[presses]
        self._pressure, whole = np.zeros(count), np.bincount(patch, area, count).astype(float)
        np.maximum.at(self._pressure, patch, force[presses] / area)
        comm.Allreduce(MPI.IN_PLACE, self._pressure, op=MPI.MAX)
        comm.Allreduce(MPI.IN_PLACE, whole)
        self._area = pairs.symmetry * whole
        self.radius = _ZONE * np.sqrt(self._area)

        across = pairs.position[presses] + pairs.gap[presses, None] * normal
        position = np.concatenate([pairs.position[presses], across])
        side = np.concatenate([2 * patch, 2 * patch + 1])
        low, length = bounding_boxes(comm, position, side, 2 * count)
        size = length / _PARTS
        bins = np.floor((position - low[side]) / size[side, None]).astype(np.int64)
        key = np.column_stack([side, pairs.bodies[presses].T.ravel(), bins])
        area, normal = np.tile(area, 2), np.tile(normal, (2, 1))
        moments = np.column_stack([area, area[:, None] * position, area[:, None] * normal])
        key, sums = sums_by_row(comm, key, moments)
        self.patch, self.body, self._size = key[:, 0] // 2, key[:, 1], size[key[:, 0]]
        self.position, self.normal = sums[:, 1:4] / sums[:, :1], sums[:, 4:]
        self.normal /= np.maximum(np.linalg.norm(self.normal, axis=1, keepdims=True), np.finfo(float).tiny)

    def stress_bound(self, cluster, points, size):
        """A bound of the normal stress that the pressure of patches causes in half-spaces: (n,) float64 [Pa].

        Local.  It is max(p) min(1, 3 A z^3 / (2 pi R^5)) at the depth z and the distance R (Boussinesq).

        Args:
            cluster: (n,) int, the cluster nearest to each point.
            points: (n, 3) float64 [m].
            size: (n,) float64, half the extent of what each point stands for [m].
        """
        patch, offset = self.patch[cluster], points - self.position[cluster]
        depth = np.abs(np.einsum("ni,ni->n", offset, self.normal[cluster]))
        aside = np.sqrt(np.maximum((offset**2).sum(axis=1) - depth**2, 0.0)) - size - self._size[cluster]
        distance2 = depth**2 + np.maximum(aside, 0.0) ** 2
        decay = _at_most_one(3 / (2 * np.pi) * self._area[patch] * depth**3, distance2**2.5)
        return decay * self._pressure[patch]

    def around(self, pairs, patches):
        """Which node pairs are, on both of their bodies, in the zone around some of the patches: (n,) bool.

        Local.

        Args:
            pairs: NodePairs.
            patches: (count,) bool.
        """
        ends = pairs.position, pairs.position + pairs.gap[:, None] * pairs.normal
        return np.logical_and(*(self._near(*end, patches) for end in zip(ends, pairs.bodies.T)))

    def _near(self, points, bodies, patches):
        """Which points of bodies are in the zone around some of the patches on the same body: (n,) bool."""
        near = np.zeros(len(points), dtype=bool)
        for body in np.unique(bodies):
            point, cluster = np.flatnonzero(bodies == body), np.flatnonzero(patches[self.patch] & (self.body == body))
            if len(cluster):
                distance, nearest = cKDTree(self.position[cluster]).query(points[point])
                near[point] = distance <= self.radius[self.patch[cluster[nearest]]]
        return near


def stored_energy(state, clusters):
    """The energy that the forces of contact patches store, about.

    Collective on state.forest.comm.  A punch with the force F and the area A stores F^2 / (E* A^(1/2)) in a half-space.
    Stiffer bodies, like thin plates, store less: at most the energy of the leaves in the zone around a patch, nearer to
    it than to others, and of each leaf at most `_OF_NORMAL` times that of the stress along the contact's normal, as far
    as the patch's own pressure can cause that (`stress_bound`).  What other loads store does not count.

    Args:
        state: SolvedState.
        clusters: PressureClusters.

    Returns:
        (count,) float64, twice the energy of each patch [J].
    """
    forest, estimate = state.forest, state.estimate
    body, leaves = forest.mesh.body[forest.cell], np.arange(len(forest))
    energy = np.empty(len(forest))
    energy[state.elasticity.leaf_mesh.leaf] = estimate.energy
    stress = _leaf_stress(state)
    # (1 + nu) s : s - nu tr(s)^2 is twice the density of energy times Young's modulus.
    poisson = np.array([state.scene.materials[name].poisson for name in state.scene.mesh.bodies])[body]
    square, trace = np.einsum("nij,nij->n", stress, stress), np.trace(stress, axis1=1, axis2=2)
    density = (1 + poisson) * square - poisson * trace**2
    half = np.linalg.norm(forest.positions(leaves, 0) - forest.centres, axis=1)

    around = np.zeros_like(clusters.force)
    for one in np.unique(clusters.body):
        leaf, cluster = np.flatnonzero(body == one), np.flatnonzero(clusters.body == one)
        distance, nearest = cKDTree(clusters.position[cluster]).query(forest.centres[leaf])
        near = distance <= clusters.radius[clusters.patch[cluster[nearest]]] + half[leaf]
        leaf, cluster = leaf[near], cluster[nearest[near]]
        along = np.einsum("ni,nij,nj->n", clusters.normal[cluster], stress[leaf], clusters.normal[cluster]) ** 2
        bound = clusters.stress_bound(cluster, forest.centres[leaf], half[leaf]) ** 2
        share = _OF_NORMAL * _at_most_one(along, density[leaf]) * _at_most_one(bound, along)
        around += np.bincount(clusters.patch[cluster], np.minimum(share, 1.0) * energy[leaf], len(around))
    return np.minimum(clusters.force * clusters.approach, forest.comm.allreduce(around))


def _leaf_stress(state):
    """Means of the recovered stress in this rank's leaves: (n, 3, 3) float64 [Pa]."""
    nodal, stress = state.elasticity.at_leaves(state.estimate.stress), np.empty((len(state.forest), 3, 3))
    for component, (i, j) in enumerate(VOIGT):
        stress[:, i, j] = stress[:, j, i] = nodal[:, :, component].mean(axis=1)
    return stress


def _at_most_one(part, whole):
    """The quotient of two non-negative arrays, at most 1, also where both are 0."""
    return np.divide(part, whole, out=np.ones(len(part)), where=part < whole)
