"""Round surfaces: their height over the tangent plane, and whether a root mesh follows them closely enough."""

import numpy as np

from fx_contact.parallel.errors import GeometryError
from fx_contact.problem import hexahedron

#: Largest distance of a surface from its sphere, relative to the approach; the force is then off by half as much.
ROUND_ENOUGH = 0.05


def sagitta(distance2, curvature):
    """Height of a sphere over its tangent plane: R - sqrt(R^2 - r^2), without cancellation.

    Local.

    Args:
        distance2: r^2, (n,) float64, squared distances from the axis [m^2].
        curvature: 1/R [1/m], 0 for a plane, negative for a hollow sphere.

    Returns:
        (n,) float64 [m], of the sign of the curvature.
    """
    return distance2 * curvature / (1 + np.sqrt(1 - distance2 * curvature**2))


def check_roundness(mesh, surface, centre, radius, contact_radius, approach):
    """Raises GeometryError for a surface too far off its sphere within twice the contact radius.

    Local.  A polynomial surface is off the sphere by a small part of the radius, and cells meet at a small angle. Where
    that is not small against the approach, the computed contact is that of the polynomials.  Order 1 is not checked: it
    means a polyhedron.

    Args:
        mesh: RootMesh.
        surface: name of the round surface, whose pole is a vertex.
        centre: of the sphere, (3,) [m].
        radius: of the sphere [m].
        contact_radius: expected, by Hertz [m].
        approach: of the bodies [m].
    """
    if mesh.order == 1 or not approach > 0:
        return
    facets = mesh.surface(surface)
    corners = mesh.facet_points(facets, order=1)
    arm = np.hypot(*np.moveaxis(corners[:, :, :2] - centre[:2], 2, 0))
    facets, arm = facets[arm.min(axis=1) < 1e-6 * radius], arm[arm.min(axis=1) < 1e-6 * radius]
    cell, face = facets.T
    along = np.linspace(0, 1, 25)[None] * np.minimum(1, 2 * contact_radius / arm.max(axis=1))[:, None]
    pole, rows = arm.argmin(axis=1), np.arange(len(facets))
    coordinates = np.empty((len(facets), 3, along.shape[1]))
    coordinates[rows, hexahedron.FACE_AXIS[face]] = hexahedron.FACE_SIDE[face][:, None]
    for bit, tangent in enumerate(hexahedron.FACE_TANGENTS[face].T):
        coordinates[rows, tangent] = np.where((pole >> bit & 1)[:, None], 1 - along, along)
    distance = np.linalg.norm(mesh.evaluate(cell, coordinates) - centre, axis=2)
    off = np.abs(distance - radius).max()
    if off > ROUND_ENOUGH * approach:
        raise GeometryError(
            f"the root mesh of order {mesh.order} leaves the sphere of {surface!r} by {off:.2g} near the pole, which "
            f"is {off / approach:.0%} of the approach of {approach:.2g}: take a higher order or more root cells"
        )
