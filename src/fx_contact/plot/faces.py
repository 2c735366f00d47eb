"""Faces of leaves that a picture shows, as surfaces and lines of pyvista."""

import numpy as np

from fx_contact.adaptive.pyvista_grid import import_pyvista
from fx_contact.fem.leaf_mesh import leaf_positions
from fx_contact.problem import hexahedron

#: From the centre of a picture to the eye.
EYE = np.array([-2.2, -4.0, 1.2])
#: Straight pieces by which an edge of a curved leaf is drawn.
PIECES = 4


def visible_faces(forest, centre, reach, cut=True):
    """Leaf faces near a point on the boundary; of a cut, of the half beyond its y, on the boundary or the cut.

    Local.

    Args:
        forest: Forest.
        centre: (3,) point [m].
        reach: leaves are near whose middle is three times that or less from it along each axis [m].
        cut: whether only the half beyond the point's y is shown.

    Returns:
        (m,) int leaves and (m,) int their local faces.
    """
    position = leaf_positions(forest, slice(None), 1)
    middle = position.mean(axis=1) - centre
    near = (np.abs(middle) < 3 * reach).all(axis=1)
    if cut:
        near &= middle[:, 1] > 0
    corners = position[near][:, hexahedron.FACE_CORNERS]
    in_plane = cut & (np.abs(corners[..., 1] - centre[1]) < 1e-9 * reach).all(axis=2)
    exterior = np.argwhere(forest.mesh.face_neighbours == 1)
    leaf, face = forest.boundary_faces(exterior)
    outer = np.zeros((len(forest), 6), dtype=bool)
    outer[leaf, face] = True
    leaf, face = np.nonzero(in_plane | outer[near])
    return np.flatnonzero(near)[leaf], face


def face_points(forest, leaf, face):
    """Points of faces of leaves, undeformed: (m, (k+1)^2, 3) float64 [m], k = `PIECES`.  Local."""
    points = leaf_positions(forest, leaf, PIECES)
    return points[np.arange(len(leaf))[:, None], hexahedron.face_nodes(PIECES)[face]]


def surface_and_edges(faces):
    """Faces of leaves as pyvista's surface, and their edges as lines; faces as `face_points` gives them.  Local."""
    count, first = PIECES + 1, faces.shape[1] * np.arange(len(faces))[:, None, None]
    quads = (first + hexahedron.subcells(PIECES, 2)[:, [0, 1, 3, 2]]).reshape(-1, 4)
    grid = np.arange(count**2).reshape(count, count)
    sides = (first + np.stack([grid[0], grid[-1], grid[:, 0], grid[:, -1]])).reshape(-1, count)
    surface, points = import_pyvista().PolyData, faces.reshape(-1, 3)
    lines = np.hstack([np.full((len(sides), 1), count), sides])
    return surface.from_regular_faces(points, quads), surface(points, lines=lines.ravel())
