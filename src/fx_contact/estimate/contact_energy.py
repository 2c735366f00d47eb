"""The energy that contact forces store, which the tolerance of each contact is relative to."""

import numpy as np
from scipy.spatial import cKDTree

from fx_contact.estimate.contact_places import at_most_one
from fx_contact.estimate.recovery import VOIGT

#: So many times the energy of the stress along the contact's normal is all of a half-space's, and more than a plate's.
#: In rings that are shrunk on each other, which hoop stresses fill, it is a seventh: they are refined for less.
_OF_NORMAL = 1.5


def stored_by_forces(forest, elasticity, poisson, estimate, places):
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
        places: Places, where the groups press.

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

    around = np.zeros_like(places.force)
    for one in np.unique(places.body):
        leaf, place = np.flatnonzero(body == one), np.flatnonzero(places.body == one)
        distance, nearest = cKDTree(places.position[place]).query(forest.centres[leaf])
        near = distance <= places.radius[places.group[place[nearest]]] + half[leaf]
        leaf, place = leaf[near], place[nearest[near]]
        along = np.einsum("ni,nij,nj->n", places.normal[place], stress[leaf], places.normal[place]) ** 2
        possible = places.stress(place, forest.centres[leaf], half[leaf]) ** 2
        share = _OF_NORMAL * at_most_one(along, density[leaf]) * at_most_one(possible, along)
        around += np.bincount(places.group[place], np.minimum(share, 1.0) * energy[leaf], len(around))
    return np.minimum(places.force * places.approach, forest.comm.allreduce(around))


def _stress(forest, elasticity, estimate):
    """Means of the recovered stress in this rank's leaves: (n, 3, 3) float64 [Pa]."""
    nodal, stress = elasticity.at_leaves(estimate.stress), np.empty((len(forest), 3, 3))
    for component, (i, j) in enumerate(VOIGT):
        stress[:, i, j] = stress[:, j, i] = nodal[:, :, component].mean(axis=1)
    return stress
