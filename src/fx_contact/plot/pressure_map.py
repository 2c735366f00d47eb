"""Contact pressure on a contact surface, seen along its normal."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fx_contact.adaptive.contact_line import facet_values
from fx_contact.adaptive.step import Step, check_step
from fx_contact.geometry import hexahedron
from fx_contact.items.units import Units, labelled
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.validation import check_name
from fx_contact.plot.canvas import axes_for, draw_on_first, on_first
from fx_contact.verdict.contact_figures import AXIS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Space around the closed nodes, relative to their extent.
_MARGIN = 0.25
#: Cosine up to which a direction is called that of a coordinate axis.
_NAMED = 0.999


@collective("step.forest.comm")
def draw_pressure_map(
    step: Step, path: str | Path | None = None, contact: str | None = None, *, ax: "Axes | None" = None
) -> "Path | Axes | None":
    """Contact pressure on the first surface of a contact around its closed nodes, seen along the contact force.

    Collective on the step's communicator; rank 0 draws, into the PNG of the path or on `ax`, which is returned.  The
    pressure is linear between the nodes.  Of a surface around a body the half that faces the eye is shown.

    Args:
        contact: name of the contact, `ContactPair.name`; None: the one with the largest force.

    Raises:
        SceneError: no step, or one without contact; an unknown contact.
        OutputError: the picture cannot be written.
    """
    check_step(step, contact=True)
    names = [one.name for one in step.scene.contact]
    if contact is not None:
        check_name("contact", contact, names)
    index = int(np.argmax(step.record.pair_forces)) if contact is None else names.index(contact)
    axes = _view(step, index)
    facets = facet_values(step, index)
    points = facets.points @ axes.T
    low, high = _window(step.forest.comm, points, facets.pressure)
    near = (points[..., :2].max(axis=1) >= low).all(axis=1) & (points[..., :2].min(axis=1) <= high).all(axis=1)
    near &= facets.normal @ axes[2] > 0
    shown = on_first(step.forest.comm, points[near], facets.pressure[near])
    units = step.scene.units
    words = {"title": names[index], "xlim": (low[0], high[0]), "ylim": (low[1], high[1])}
    words |= {
        f"{name}label": labelled(_direction(np.asarray(axis)), "length", units) for name, axis in zip("xy", axes[:2])
    }
    draw = partial(_draw_map, shown=shown, words=words, units=units)
    return draw_on_first(step.forest.comm, path, draw, axes_for, ax)


def _view(step: Step, index: int) -> FloatArray:
    """Directions (3, 3) to the right, upward, and along the force of a contact, out of its first body.

    Collective.  Without one direction of the forces it is the normal at the largest pressure.
    """
    contact, comm = step.contact, step.forest.comm
    ours = contact.pair == index
    vector = comm.allreduce(contact.force[ours] @ contact.normal[ours])
    vector = step.scene.mirrors.force(vector)
    length = step.scene.mirrors.parts * comm.allreduce(float(contact.force[ours].sum()))
    if np.linalg.norm(vector) <= AXIS * length:
        order = np.argsort(-contact.pressure[ours], kind="stable")[:1]
        rows = zip(-contact.pressure[ours][order], contact.key[ours][order], contact.normal[ours][order])
        vector = min((row for part in comm.allgather([*rows]) for row in part), key=lambda row: row[:2])[2]
    normal = vector / np.linalg.norm(vector)
    right = np.eye(3)[np.argmin(np.abs(normal).round(6))]
    right = right - (right @ normal) * normal
    right /= np.linalg.norm(right)
    up = np.cross(normal, right)
    return np.stack([right, up * np.sign(up[np.argmax(np.abs(up))]), normal])


def _window(comm: MPI.Intracomm, points: FloatArray, pressure: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lower and upper corner (2,) [m] of the picture: nodes with pressure, or all, and a margin.  Collective."""
    pressed = pressure > 0
    if not comm.allreduce(bool(pressed.any()), op=MPI.LOR):
        pressed[:] = True
    shown = points[pressed][:, :2]
    low, high = shown.min(axis=0, initial=np.inf), shown.max(axis=0, initial=-np.inf)
    comm.Allreduce(MPI.IN_PLACE, low, op=MPI.MIN)
    comm.Allreduce(MPI.IN_PLACE, high, op=MPI.MAX)
    margin = _MARGIN * max((high - low).max(), 1e-12 * np.abs(high).max())
    return low - margin, high + margin


def _draw_map(axes: "Axes", shown: list[FloatArray], words: dict[str, Any], units: Units) -> None:
    from matplotlib.collections import LineCollection
    from matplotlib.tri import Triangulation

    points, pressure = shown
    count = round(points.shape[1] ** 0.5)
    quads = hexahedron.subcells(count - 1, 2)
    first = points.shape[1] * np.arange(len(points))[:, None, None]
    triangles = (first + np.concatenate([quads[:, [0, 1, 2]], quads[:, [1, 3, 2]]])).reshape(-1, 3)
    x, y = points[..., :2].reshape(-1, 2).T
    mesh = Triangulation(x, y, triangles)
    coloured = axes.tripcolor(mesh, pressure.ravel(), shading="gouraud", cmap="viridis", vmin=0)
    grid = np.arange(count**2).reshape(count, count)
    sides = np.concatenate([points[:, side, :2] for side in (grid[0], grid[-1], grid[:, 0], grid[:, -1])])
    axes.add_collection(LineCollection(list(sides), colors="white", linewidths=0.5, alpha=0.5))
    axes.figure.colorbar(coloured, ax=axes, label=labelled("contact pressure", "stress", units))
    axes.set(aspect="equal", **words)


def _direction(vector: npt.NDArray[Any]) -> str:
    """Name of a direction: an axis, or its components."""
    if np.abs(vector).max() > _NAMED:
        return "xyz"[int(np.argmax(np.abs(vector)))]
    return "along (" + ", ".join(f"{value + 0.0:.2g}" for value in vector.round(3)) + ")"
