"""Faces of leaves and of rigid obstacles for pictures, as points (m, (k+1)^2, 3) [m] with k = `PIECES`."""

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fx_contact.adaptive.pyvista_grid import import_pyvista
from fx_contact.adaptive.step import Step
from fx_contact.contact.constraint_rows import ConstraintRows, RowKind
from fx_contact.fem.leaf_mesh import leaf_positions
from fx_contact.forest.forest import Forest
from fx_contact.geometry import hexahedron, lattice
from fx_contact.items.contact import ContactPair
from fx_contact.parallel.arrays import FloatArray, Int64Array, IntArray
from fx_contact.plot.canvas import on_first

#: Straight pieces k of an edge of a curved leaf.
PIECES = 4


def visible_faces(
    forest: Forest, centre: FloatArray, reach: float = np.inf, cut: bool = True
) -> tuple[Int64Array, Int64Array]:
    """This rank's leaves (m,) and their local faces (m,) on the boundary near a point (3,); cut, those beyond its y.

    Local.  Near are leaves whose centre is within three times the reach along each axis [m].
    """
    position = leaf_positions(forest, slice(None), 1)
    middle = position.mean(axis=1) - centre
    near = (np.abs(middle) < 3 * reach).all(axis=1)
    if cut:
        near &= middle[:, 1] > 0
    corners = position[near][:, hexahedron.FACE_CORNERS]
    rounding = 1e-9 * np.ptp(forest.mesh.points)
    in_plane = cut & (np.abs(corners[..., 1] - centre[1]) < rounding).all(axis=2)
    outer = lattice.root_faces(forest.anchor, forest.level) & (forest.mesh.face_neighbours == 1)[forest.cell]
    leaf, face = np.nonzero(in_plane | outer[near])
    return np.flatnonzero(near)[leaf], face


def face_points(forest: Forest, leaf: IntArray, face: IntArray) -> FloatArray:
    """Points of leaf faces (m,), undeformed.  Local."""
    points = leaf_positions(forest, leaf, PIECES)
    return points[np.arange(len(leaf))[:, None], hexahedron.face_nodes(PIECES)[face]]


def surface_of(faces: FloatArray, values: npt.NDArray[Any] | None = None) -> Any:
    """Surface of faces, with "value" at points or on pieces, as PolyData of pyvista.  Local."""
    first = faces.shape[1] * np.arange(len(faces))[:, None, None]
    quads = (first + hexahedron.subcells(PIECES, 2)[:, [0, 1, 3, 2]]).reshape(-1, 4)
    surface = import_pyvista().PolyData.from_regular_faces(faces.reshape(-1, 3), quads)
    if values is not None:
        surface["value"] = values.ravel()
    return surface


def edges_of(faces: FloatArray) -> Any:
    """Lines along the edges of faces, as PolyData of pyvista.  Local."""
    grid = np.arange(faces.shape[1]).reshape(PIECES + 1, PIECES + 1)
    sides = np.stack([grid[0], grid[-1], grid[:, 0], grid[:, -1]])
    lines = (faces.shape[1] * np.arange(len(faces))[:, None, None] + sides).reshape(-1, PIECES + 1)
    counted = np.insert(lines, 0, PIECES + 1, axis=1)
    return import_pyvista().PolyData(faces.reshape(-1, 3), lines=counted.ravel())


def placed_obstacles(step: Step, factor: float) -> list[FloatArray]:
    """Faces of each rigid obstacle of a step, with its clearance, where it faces the contact surface; on rank 0 alone.

    Collective.  Where an obstacle has moved into the undeformed body, along its force or displacement, this part of its
    way is multiplied by the factor of the displacements: 0 for undeformed bodies, which it then touches.
    """
    result: list[FloatArray] = []
    for kind in () if step.rows is None else step.rows.kinds:
        pair = kind.contact
        if step.rows is None or not isinstance(pair, ContactPair) or pair.obstacle is None:
            continue
        x, y, z = np.array(pair.moved) + (factor - 1) * _way_inside(step.rows, kind, pair)
        pair = replace(pair, moved=(float(x), float(y), float(z)))
        points = face_points(step.forest, *kind.facets(step.forest))
        distance, towards = pair.distances(points.reshape(-1, 3))
        way = ((distance + pair.clearance)[:, None] * towards).reshape(points.shape)
        result += on_first(step.forest.comm, points + way)
    return result


def _way_inside(rows: ConstraintRows, kind: RowKind, pair: ContactPair) -> FloatArray:
    """The end of an obstacle's way (3,), on which it penetrates the undeformed body [m].  Collective."""
    along = np.array(pair.moved if pair.force is None else pair.force, dtype=np.float64)
    along = along / (np.linalg.norm(along) or 1.0)
    ours = rows.contact == kind.index
    rate, depth = -rows.normal[ours] @ along, -rows.gap[ours]
    inside = float((depth[rate > 0] / rate[rate > 0]).max(initial=0.0))
    return np.asarray(rows.prolongation.comm.allreduce(inside, op=MPI.MAX) * along)


def contact_size(step: Step) -> float:
    """Contact radius [m]; of contact that is not round that of a circle of the closed area, or of the surface if open.

    Collective on the step's communicator.
    """
    record = step.record
    closed = step.solution.active | (record.active_pairs == 0)
    area = step.scene.symmetry * step.forest.comm.allreduce(float(step.contact_rows.area[closed].sum()))
    return record.contact_radius or float(np.sqrt(area / np.pi))
