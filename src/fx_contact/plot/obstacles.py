"""Rigid obstacles in pictures."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from mpi4py import MPI

from fx_contact.adaptive.pyvista_grid import import_pyvista
from fx_contact.adaptive.step import Step
from fx_contact.contact.constraint_rows import ConstraintRows, RowKind
from fx_contact.items.contact import ContactPair
from fx_contact.items.obstacles import RigidSurface
from fx_contact.parallel.arrays import FloatArray
from fx_contact.plot.canvas import on_first
from fx_contact.plot.faces import face_points, surface_and_edges

if TYPE_CHECKING:
    from pyvista import Plotter

#: An obstacle, or on rank 0 points of one by functions, as from `face_points`.
Shown: TypeAlias = ContactPair | FloatArray

#: Points along each side of the box in which obstacles are drawn, and its margin relative to the bodies.
_POINTS, _MARGIN = 80, 0.05


def placed_obstacles(step: Step, factor: float) -> list[Shown]:
    """The obstacles of a step with clearances; of those by functions the part that faces the contact surface.

    Collective.  Where an obstacle has moved into the undeformed body, along its force or displacement, this part of its
    way is multiplied by the factor of the displacements: 0 for undeformed bodies, which it then touches.
    """
    result: list[Shown] = []
    for kind in () if step.rows is None else step.rows.kinds:
        pair = kind.contact
        if step.rows is None or not isinstance(pair, ContactPair) or pair.obstacle is None:
            continue
        way = (factor - 1) * _way_inside(step.rows, kind, pair)
        x, y, z = np.array(pair.moved) + way
        pair = replace(pair, moved=(float(x), float(y), float(z)))
        if not isinstance(pair.obstacle, RigidSurface):
            result.append(pair)
            continue
        points = face_points(step.forest, *kind.facets(step.forest))
        distance, towards = pair.distances(points.reshape(-1, 3))
        result += on_first(
            step.forest.comm, points + ((distance + pair.clearance)[:, None] * towards).reshape(points.shape)
        )
    return result


def _way_inside(rows: ConstraintRows, kind: RowKind, pair: ContactPair) -> FloatArray:
    """The end of an obstacle's way (3,), on which it penetrates the undeformed body [m].  Collective."""
    along = np.array(pair.moved, dtype=np.float64)
    if pair.force is not None and pair.unit_direction is not None:
        along = -pair.unit_direction
    along = along / (np.linalg.norm(along) or 1.0)
    ours = rows.contact == kind.index
    rate, depth = -rows.normal[ours] @ along, -rows.gap[ours]
    inside = float((depth[rate > 0] / rate[rate > 0]).max(initial=0.0))
    return np.asarray(rows.prolongation.comm.allreduce(inside, op=MPI.MAX) * along)


def add_obstacles(plotter: "Plotter", obstacles: Sequence[Shown], points: FloatArray) -> None:
    """Add the part of each obstacle in the box around points (n, 3) [m], translucent.  Local."""
    low, high = points.min(axis=0), points.max(axis=0)
    margin = _MARGIN * (high - low).max()
    axes = [np.linspace(start - margin, end + margin, _POINTS) for start, end in zip(low, high)]
    for obstacle in obstacles:
        if isinstance(obstacle, ContactPair):
            grid = import_pyvista().RectilinearGrid(*axes)
            grid["gap"] = obstacle.distances(np.asarray(grid.points))[0] + obstacle.clearance
            surface = grid.contour([0.0], scalars="gap")
        else:
            box = np.stack([low - margin, high + margin], axis=1).ravel()
            surface = surface_and_edges(obstacle)[0].clip_box(box, invert=False)
        if surface.n_points:
            plotter.add_mesh(surface, color="#8090a0", opacity=0.3)
