"""Map of a contact: pressure, tangential traction, or stick and slip, on the first surfaces."""

from pathlib import Path
from typing import Any

import numpy as np

from fx_contact.adaptive.step import Step, check_step
from fx_contact.geometry import hexahedron
from fx_contact.items.units import labelled
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int64Array
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.validation import check_name, check_number
from fx_contact.plot import canvas, surfaces
from fx_contact.results.contact_surface import nodal_values
from fx_contact.verdict.contact_figures import AXIS

#: Fields, and their names in the picture.
_FIELDS = {"pressure": "contact pressure", "traction": "tangential traction", "status": "contact"}
#: Status of contact, and its colours.
_STATUS = {0.0: "open", 1.0: "stick", 2.0: "slip"}
_OF_STATUS = ["#d8d8d8", "#0072B2", "#E69F00"]
#: Eye for surfaces without a mean normal, as of a bore; up, unless the eye is there.
_EYE, _UP = np.array([-0.4, -0.7, 0.5]), np.eye(3)[[2, 1]]


@collective("step.forest.comm")
def draw_contact(
    step: Step,
    path: str | Path | None = None,
    field: str = "pressure",
    zoom: float | None = 1.5,
    *,
    plotter: Any = None,
) -> Any:
    """Undeformed first surfaces of the contacts and their facets, from outside along their normal, with a field.

    Collective on the step's communicator; rank 0 draws and receives these faces only.

    Args:
        path: of the PNG, if no plotter is given.
        field: "pressure", with friction also "traction", the length of its vector, and "status": open, stick, slip
            or closed without friction.
        zoom: half width of the picture, in contact radii, around the contact; None: whole surfaces.
        plotter: of pyvista, to draw on, the one of rank 0; it or the path is returned.

    Raises:
        SceneError: no step, or one without contact, or friction if that is drawn; an unknown field; an invalid zoom.
        OutputError: the picture cannot be written.
    """
    check_name("field", field, _FIELDS)
    check_step(step, contact=True)
    if zoom is not None:
        check_number("the zoom of a picture", zoom, positive=True)
    if field != "pressure" and step.solution.traction is None:
        raise SceneError(f"the scene {step.scene.name!r} has no friction, so there is no {field} to show")
    units, comm, centre = step.scene.units, step.forest.comm, np.asarray(step.record.contact_centre)
    leaf, face, outward, covered = _first_surfaces(step)
    points = surfaces.face_points(step.forest, leaf, face)
    shown = canvas.on_first(comm, points, _values(step, leaf, face, field), outward, covered)
    whole = float(np.ptp(step.scene.mesh.points, axis=0).max())
    reach = np.inf if zoom is None else min(zoom * surfaces.contact_size(step), whole)
    name = _FIELDS[field] if field == "status" else labelled(_FIELDS[field], "stress", units).replace(" [", "\n[")

    def draw(plotter: Any) -> None:
        """The surfaces with their legend, on rank 0."""
        points, values, outward, covered = shown
        surface = surfaces.surface_of(points, values).extract_cells(covered.ravel())
        scale: dict[str, Any] = {"clim": (0, values.max() or 1.0), "cmap": "viridis", "scalar_bar_args": canvas.bar()}
        if field == "status":
            scale = {"clim": (-0.5, 2.5), "cmap": _OF_STATUS, "annotations": _STATUS}
            scale["scalar_bar_args"] = canvas.bar(n_labels=0)
        plotter.add_mesh(surface, scalars="value", lighting=False, **scale)
        plotter.add_mesh(surfaces.edges_of(points), color="black", opacity=0.4, line_width=1.5, lighting=False)
        distance = np.linalg.norm(points - centre, axis=2).min(axis=1)
        near = distance <= max(reach, distance.min())
        outward, around = outward[near], points[near].reshape(-1, 3)
        mean, area = outward.sum(axis=0), np.linalg.norm(outward, axis=1).sum()
        eye = mean / area if np.linalg.norm(mean) > AXIS * area else _EYE
        canvas.look(plotter, eye, _UP[int(abs(eye[2]) > 0.8)])
        if zoom is not None:
            canvas.look_at(plotter, (around.min(axis=0) + around.max(axis=0)) / 2, reach)
        canvas.add_legend(plotter, name, units)

    return canvas.draw_on_first(comm, path, draw, canvas.plotter_for, plotter)


def _first_surfaces(step: Step) -> tuple[Int64Array, Int64Array, FloatArray, BoolArray]:
    """On first surfaces of contacts this rank's leaves (m,), local faces (m,), outward areas (m, 3) [m^2], and pieces
    (m, k^2) that face something."""
    forest, columns = step.forest, []
    middles = (np.arange(surfaces.PIECES) + 0.5) / surfaces.PIECES
    uv = np.stack(np.meshgrid(middles, middles), axis=-1).reshape(-1, 2)
    for kind in step.contact_rows.kinds:
        leaf, face = kind.facets(forest)
        facets = forest.facets(leaf, face)
        columns.append((leaf, face, facets.mean_outward, kind.covered(facets, uv)))
    leaf, face, outward, covered = map(np.concatenate, zip(*columns))
    return leaf, face, outward, covered


def _values(step: Step, leaf: Int64Array, face: Int64Array, field: str) -> FloatArray:
    """A field at the points of faces (m, (k+1)^2); the status of their pieces (m, k^2).  Collective."""
    between = hexahedron.bilinear_interpolation(step.record.degree, surfaces.PIECES)
    nodal = between @ nodal_values(step)[step.elasticity.prolongation.space.on_faces(leaf, face)]
    if field == "pressure":
        return np.asarray(nodal[..., 3])
    if field == "traction":
        return np.asarray(np.linalg.norm(nodal[..., 6:9], axis=2))
    pieces = nodal[:, hexahedron.subcells(surfaces.PIECES, 2)].mean(axis=2)
    closed, slips = pieces[..., 4], pieces[..., 12]
    return np.where(closed > 0.5, 1.0 + (slips > closed / 2), 0.0)
