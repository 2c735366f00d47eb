"""Rigid obstacles in pictures."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fx_contact.adaptive.pyvista_grid import import_pyvista
from fx_contact.parallel.arrays import FloatArray
from fx_contact.problem.contact import ContactPair
from fx_contact.problem.obstacles import RigidSurface
from fx_contact.problem.scene import Scene

if TYPE_CHECKING:
    from pyvista import Plotter

#: Points along each side of the box in which obstacles are drawn, and its margin relative to the bodies.
_POINTS, _MARGIN = 80, 0.05


def add_obstacles(plotter: "Plotter", scene: Scene, points: FloatArray, factor: float) -> None:
    """Add the part of each obstacle in the box around points (n, 3) [m], translucent.  Local.

    Those by functions, which need not be known off the contact surface, are left out.

    Args:
        factor: magnification of the displacement of the obstacles.
    """
    pairs = [pair for pair in scene.contact if isinstance(pair, ContactPair) and pair.obstacle is not None]
    low, high = points.min(axis=0), points.max(axis=0)
    margin = _MARGIN * (high - low).max()
    axes = [np.linspace(start - margin, end + margin, _POINTS) for start, end in zip(low, high)]
    for pair in (pair for pair in pairs if not isinstance(pair.obstacle, RigidSurface)):
        x, y, z = pair.moved
        grid = import_pyvista().RectilinearGrid(*axes)
        grid["gap"] = replace(pair, moved=(factor * x, factor * y, factor * z)).distances(np.asarray(grid.points))[0]
        surface = grid.contour([0.0], scalars="gap")
        if surface.n_points:
            plotter.add_mesh(surface, color="#8090a0", opacity=0.3)
