"""Faces of leaves for pictures, as surfaces and lines of pyvista.  All is local."""

from typing import TYPE_CHECKING

import numpy as np

from fx_contact.adaptive.pyvista_grid import import_pyvista
from fx_contact.fem.leaf_mesh import leaf_positions
from fx_contact.forest.forest import Forest
from fx_contact.geometry import hexahedron
from fx_contact.parallel.arrays import FloatArray, Int64Array, IntArray

if TYPE_CHECKING:
    from pyvista import PolyData

#: Direction from the picture to the eye.
EYE = np.array([-2.2, -4.0, 1.2])
#: Straight pieces k of an edge of a curved leaf.
PIECES = 4


def visible_faces(
    forest: Forest, centre: FloatArray, reach: float, cut: bool = True
) -> tuple[Int64Array, Int64Array]:
    """This rank's leaves (m,) and their local faces (m,) on the boundary near a point (3,); cut, those beyond its y.

    Near are leaves whose centre is within three times the reach along each axis [m].
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


def face_points(forest: Forest, leaf: IntArray, face: IntArray) -> FloatArray:
    """Points of leaf faces, undeformed: (m, (k+1)^2, 3) [m], k = `PIECES`."""
    points = leaf_positions(forest, leaf, PIECES)
    return points[np.arange(len(leaf))[:, None], hexahedron.face_nodes(PIECES)[face]]


def surface_and_edges(faces: FloatArray) -> "tuple[PolyData, PolyData]":
    """Surface of leaf faces, given by `face_points`, and lines along their edges."""
    count, first = PIECES + 1, faces.shape[1] * np.arange(len(faces))[:, None, None]
    quads = (first + hexahedron.subcells(PIECES, 2)[:, [0, 1, 3, 2]]).reshape(-1, 4)
    grid = np.arange(count**2).reshape(count, count)
    sides = (first + np.stack([grid[0], grid[-1], grid[:, 0], grid[:, -1]])).reshape(-1, count)
    surface, points = import_pyvista().PolyData, faces.reshape(-1, 3)
    lines = np.hstack([np.full((len(sides), 1), count), sides])
    return surface.from_regular_faces(points, quads), surface(points, lines=lines.ravel())
