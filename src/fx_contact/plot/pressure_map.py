"""Contact pressure on a contact surface, seen along its normal."""

from pathlib import Path
from typing import Any

import numpy as np

from fx_contact.adaptive.contact_line import facet_values
from fx_contact.adaptive.contact_table import ContactTable
from fx_contact.adaptive.step import Step, check_step
from fx_contact.geometry import hexahedron
from fx_contact.items.units import labelled
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.validation import check_name
from fx_contact.plot.canvas import axes_for, draw_on_first, on_first
from fx_contact.verdict.contact_figures import AXIS

#: Space around the nodes with pressure, relative to their extent.
_MARGIN = 0.25


@collective("step.forest.comm")
def draw_pressure_map(
    step: Step, path: str | Path | None = None, contact: str | None = None, *, ax: Any = None
) -> Any:
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
    names, units = [one.name for one in step.scene.contact], step.scene.units
    if contact is not None:
        check_name("contact", contact, names)
    index = int(np.argmax(step.record.pair_forces)) if contact is None else names.index(contact)
    facets = facet_values(step, index)
    shown = on_first(step.forest.comm, facets.points, facets.pressure, facets.normal)
    table = step.contact.gathered()

    def draw(axes: Any) -> None:
        """The facets that face the eye, and lines around them."""
        points, pressure, normal = shown
        view = _view(step, index, table)
        facing = normal @ view[2] > 0
        points, pressure = points[facing] @ view.T, pressure[facing]
        coloured = _add_facets(axes, points, pressure)
        axes.figure.colorbar(coloured, ax=axes, label=labelled("contact pressure", "stress", units))
        pressed = points[(pressure > 0) | (pressure.max() <= 0), :2]
        low, high = pressed.min(axis=0), pressed.max(axis=0)
        margin = _MARGIN * (high - low).max()
        (left, right), (bottom, top) = np.stack([low - margin, high + margin], axis=1)
        axes.set(aspect="equal", title=names[index], xlim=(left, right), ylim=(bottom, top))
        axes.set_xlabel(labelled(_direction(view[0]), "length", units))
        axes.set_ylabel(labelled(_direction(view[1]), "length", units))

    return draw_on_first(step.forest.comm, path, draw, axes_for, ax)


def _view(step: Step, index: int, table: ContactTable | None) -> FloatArray:
    """Directions (3, 3) to the right, upward, and along the force of a contact, out of its first body.

    Without one direction of the forces it is the normal at the largest pressure.
    """
    assert table is not None, "gathered on rank 0"
    alignment = (step.record.pair_alignments or [])[index]
    towards = np.array(step.resultants[index].force)
    if alignment is None or alignment <= AXIS:
        towards = table.normal[np.argmax(np.where(table.pair == index, table.pressure, -1.0))]
    towards = towards / np.linalg.norm(towards)
    right = np.eye(3)[np.argmin(np.abs(towards).round(6))]
    right = right - (right @ towards) * towards
    right /= np.linalg.norm(right)
    up = np.cross(towards, right)
    return np.stack([right, up * np.sign(up[np.argmax(np.abs(up))]), towards])


def _add_facets(axes: Any, points: FloatArray, pressure: FloatArray) -> Any:
    """Add facets (m, (p+1)^2, 3) with their pressure, and lines around them; returns what has the colours."""
    from matplotlib.collections import LineCollection

    count = round(points.shape[1] ** 0.5)
    quads = hexahedron.subcells(count - 1, 2)
    first = points.shape[1] * np.arange(len(points))[:, None, None]
    triangles = (first + np.concatenate([quads[:, [0, 1, 2]], quads[:, [1, 3, 2]]])).reshape(-1, 3)
    x, y = points[..., :2].reshape(-1, 2).T
    grid = np.arange(count**2).reshape(count, count)
    sides = np.concatenate([points[:, side, :2] for side in (grid[0], grid[-1], grid[:, 0], grid[:, -1])])
    coloured = axes.tripcolor(x, y, triangles, pressure.ravel(), shading="gouraud", cmap="viridis", vmin=0)
    axes.add_collection(LineCollection(list(sides), colors="white", linewidths=0.5, alpha=0.5))
    return coloured


def _direction(vector: FloatArray) -> str:
    """Name of a direction: an axis, within 3 degrees, or its components."""
    if np.abs(vector).max() > 0.999:
        return "xyz"[int(np.argmax(np.abs(vector)))]
    return "along (" + ", ".join(f"{value + 0.0:.2g}" for value in vector.round(3)) + ")"
