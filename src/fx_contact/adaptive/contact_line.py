"""Pressure and gap between the contact nodes: on facets of a surface, and along a line on it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

from fx_contact.estimate.solved_state import SolvedState
from fx_contact.fem.leaf_mesh import leaf_positions
from fx_contact.geometry import hexahedron
from fx_contact.parallel.arrays import BoolArray, FloatArray
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_vector, shown

#: Distance from the line, and of two points on it, that is rounding, relative to its length.
_ROUNDING = 1e-9
#: Sine of the least angle between a line and the normal of the surface.
_ALONG = 0.1


@dataclass(frozen=True, eq=False)
class ContactLine:
    """Contact along a line, at its crossings with the lines between the nodes of facets; alike on all ranks.

    Attributes:
        distance: (n,), from the start along the line, increasing [m].
        points: (n, 3), undeformed positions on the first surface [m].
        pressure: (n,), linear between the nodes [Pa].
        gap: (n,), as `ContactTable.gap`, linear between the nodes [m].
    """

    distance: FloatArray
    points: FloatArray
    pressure: FloatArray
    gap: FloatArray


@dataclass(frozen=True, eq=False)
class FacetValues:
    """Contact on this rank's facets of the first surface of one contact, at their nodes; first tangent fastest.

    Attributes:
        points: (m, (p+1)^2, 3), undeformed [m].
        pressure: (m, (p+1)^2) [Pa].
        gap: (m, (p+1)^2) [m].
        normal: (m, 3), outward unit normal of the root facet [-].
    """

    points: FloatArray
    pressure: FloatArray
    gap: FloatArray
    normal: FloatArray


def nodal_means(state: SolvedState, contact: int | None = None) -> FloatArray:
    """Pressure [Pa], status (1 closed) and open gap [m] at owned conforming nodes, 0 off the contact: (m, 3).

    Collective on state.forest.comm.  A node with several rows has their mean, weighted by their areas.

    Args:
        contact: index of the only one that counts; None: all.
    """
    rows, solution, prolongation = state.rows, state.solution, state.elasticity.prolongation
    assert rows is not None, "of a scene with contact"
    weight = rows.area if contact is None else rows.area * (rows.contact == contact)
    columns = solution.pressure, solution.active, -solution.penetration, np.ones(len(rows))
    values = weight[:, None] * np.column_stack(columns)
    sums = prolongation.zeros(4)
    entries = rows.entries
    np.add.at(sums, entries.node, np.abs(entries.weight)[:, None] * values[entries.row])
    sums = prolongation.summed(sums)
    return np.asarray(sums[:, :3] / np.where(sums[:, 3:] > 0, sums[:, 3:], 1.0))


def facet_values(state: SolvedState, contact: int) -> FacetValues:
    """Contact on the facets of the first surface of a contact, by its index.  Collective on state.forest.comm."""
    forest, prolongation = state.forest, state.elasticity.prolongation
    space, surfaces = prolongation.space, forest.contact_surfaces
    leaf, face = forest.contact_faces()
    root = forest.cell[leaf], face
    ours = (surfaces.contact[root] == contact) & (surfaces.side[root] == 0)
    leaf, face = leaf[ours], face[ours]
    nodal = prolongation.prolong(nodal_means(state, contact))[space.on_faces(leaf, face)]
    degree = int(space.degree)
    nodes = np.arange(len(leaf))[:, None], hexahedron.face_nodes(degree)[face]
    points = leaf_positions(forest, leaf, degree)[nodes]
    normal = forest.mesh.outward_normals(np.column_stack([forest.cell[leaf], face]))
    return FacetValues(points, nodal[..., 0], nodal[..., 2], normal)


def check_line(start: Any, end: Any) -> tuple[FloatArray, FloatArray, float]:
    """Start (3,) [m], direction (3,) and length [m] of a line.  Local.  Raises SceneError if it is none."""
    check_vector("the start of a line", start)
    check_vector("the end of a line", end)
    first = np.array(start, dtype=np.float64)
    way: FloatArray = np.array(end, dtype=np.float64) - first
    length = float(np.linalg.norm(way))
    if not length:
        raise SceneError(f"a line needs two points, got {shown(start)} twice")
    return first, np.asarray(way / length, dtype=np.float64), length


def cut_line(
    comm: MPI.Intracomm, facets: FacetValues, line: tuple[FloatArray, FloatArray, float], normal: FloatArray
) -> ContactLine:
    """Contact in the plane through a line along a normal (3,) of the surface, on facets that face this way.

    Collective on comm.  Raises SceneError if the line is along the normal, or does not meet a facet.
    """
    start, along, length = line
    across = np.cross(along, normal)
    sine = float(np.linalg.norm(across))
    if sine < _ALONG:
        raise SceneError("the line is perpendicular to the contact surface: it must lead along it")
    facing = facets.normal @ normal > 0
    points, distance = facets.points[facing], (facets.points[facing] - start) @ (across / sine)
    distance[np.abs(distance) < _ROUNDING * length] = 0.0
    values = np.concatenate([points, facets.pressure[facing, :, None], facets.gap[facing, :, None]], axis=2)
    first, second = _edges(points.shape[1])
    ends, f, g = (values[:, first], values[:, second]), distance[:, first], distance[:, second]
    crossed = f * g <= 0
    share = (f[crossed] / np.where(f == g, 1.0, f - g)[crossed])[:, None]
    found = (1 - share) * ends[0][crossed] + share * ends[1][crossed]
    place = (found[:, :3] - start) @ along
    inside = (place >= -_ROUNDING * length) & (place <= (1 + _ROUNDING) * length)
    rows = np.concatenate(comm.allgather(np.column_stack([place, found])[inside]))
    rows = rows[np.lexsort(rows.T[::-1])]
    rows = rows[_apart(rows[:, 0], _ROUNDING * length)]
    if not len(rows):
        raise SceneError("the line does not meet the contact surface: it must lie on it, or above it")
    place = np.where(rows[:, 0] < _ROUNDING * length, 0.0, rows[:, 0])
    return ContactLine(place, rows[:, 1:4], rows[:, 4], rows[:, 5])


def _edges(nodes: int) -> tuple[Any, Any]:
    """First and second nodes of the lines between the nodes of a facet."""
    grid = np.arange(nodes).reshape(round(nodes**0.5), -1)
    pairs = (grid[:, :-1], grid[:, 1:]), (grid[:-1], grid[1:])
    return tuple(np.concatenate([pair[side].ravel() for pair in pairs]) for side in (0, 1))


def _apart(place: FloatArray, least: float) -> BoolArray:
    """True for the first of sorted numbers that are as good as equal."""
    return np.diff(place, prepend=-np.inf) > least
