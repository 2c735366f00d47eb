"""Leaf facets of contact pairs: where their points are, and the areas of their nodes."""

import numpy as np

from fx_contact.problem import hexahedron


def facets_of(index, forest):
    """This rank's leaf facets on the first surface of a contact pair.

    Local.

    Args:
        index: of the contact pair in the scene.
        forest: Forest.

    Returns:
        (n,) int64 leaves, (n,) int64 their local faces.
    """
    leaf, face = forest.contact_faces()
    cell, pairing = forest.cell[leaf], forest.pairing
    ours = pairing.first[cell, face] & (pairing.pair[cell, face] == index)
    return leaf[ours], face[ours]


def positions_across(forest, leaf, face, points):
    """Positions of points of contact facets, and of the points that face them, on the true curved geometry.

    Local.

    Args:
        forest: Forest.
        leaf, face: (n,) int64, leaves and their local faces, all paired.
        points: (n, m, 3) int32, lattice coordinates on those faces; float64 between lattice points.

    Returns:
        two (n, m, 3) float64 [m].
    """
    cell, _, opposite = forest.pairing.opposite(forest.cell[leaf], face, points)
    return forest.evaluate(forest.cell[leaf], points), forest.evaluate(cell, opposite)


def facet_shares(space, nodes, face):
    """Integrals of the functions of facet nodes over the facets that these span, exact for a uniform pressure.

    Local.

    Args:
        space: Space.
        nodes: (n, (p+1)^2, 3) float64, positions of the facet nodes [m].
        face: (n,) int, local faces.

    Returns:
        (n, (p+1)^2) float64 areas [m^2], and (n, (p+1)^2, 3) areas times the outward normals.
    """
    weights, value, along_u, along_v = space.facet_rule
    normal = np.cross(along_u @ nodes, along_v @ nodes) * hexahedron.FACE_ORIENTATION[face][:, None, None]
    value = weights[:, None] * value
    return np.linalg.norm(normal, axis=2) @ value, value.T @ normal
