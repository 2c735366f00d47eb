"""Deformed bodies in three dimensions with contact pressure or stress on their surfaces."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fx_contact.adaptive.step import Step, check_step
from fx_contact.estimate.stress_recovery import von_mises
from fx_contact.geometry import hexahedron
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.items.units import labelled
from fx_contact.parallel.arrays import FloatArray, Int64Array
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.validation import check_name, check_number
from fx_contact.plot.canvas import (
    add_length,
    add_note,
    bar,
    draw_on_first,
    exceeded,
    leave_strip,
    on_first,
    picture_size,
    plotter_for,
    view_axes,
)
from fx_contact.plot.faces import EYE, PIECES, face_points, surface_and_edges, visible_faces
from fx_contact.plot.obstacles import add_obstacles, placed_obstacles
from fx_contact.results.contact_surface import contact_faces, face_interpolation, nodal_values

if TYPE_CHECKING:
    from pyvista import Plotter

#: Fields on the surfaces, and their names in the picture.
_FIELDS = {"pressure": "contact pressure", "stress": "von Mises stress"}
#: Right, up and towards the eye, higher than in other pictures to show lower bodies from above.
_AXES = view_axes(EYE + [0, 0, 1.6], np.array([0.0, 0, 1]))
#: Share of the surface with a stress above the scale: singular at edges, its maximum grows with every level.
_SATURATED = 0.005


@collective("step.forest.comm")
def draw_bodies(
    step: Step,
    path: str | Path | None = None,
    field: str = "pressure",
    *,
    factor: float = 1.0,
    apart: float = 0.0,
    cut: bool = False,
    zoom: float = 1.0,
    top: float | None = None,
    plotter: "Plotter | None" = None,
) -> "Path | Plotter | None":
    """Deformed bodies and their leaves, coloured by contact pressure or by von Mises stress, and rigid obstacles.

    Collective on the step's communicator; rank 0 draws and receives the faces on the surface only.

    Args:
        path: of the PNG, if no plotter is given.
        field: "pressure" or "stress".
        factor: magnification of the displacements.
        apart: distance by which bodies are moved out of the common centre, relative to that of their own centres from
            it.
        cut: omit the half before the plane across y through the centre of the contact; leaves are not cut.
        zoom: magnification; 1 shows all bodies, above it the centre of the contact is in the middle.
        top: of the colour scale [Pa]; None: the maximum pressure, or the stress exceeded on 0.5 % of the surface.
        plotter: to draw on, the one of rank 0; it or the path is returned.

    Raises:
        SceneError: no step, or one without contact if the pressure is drawn; an unknown field; an invalid number.
        OutputError: the picture cannot be written.
    """
    check_name("field", field, _FIELDS)
    check_step(step, contact=field == "pressure")
    check_number("the zoom of a picture", zoom, positive=True)
    check_number("the factor of the displacements", factor)
    check_number("the distance apart", apart)
    if top is not None:
        check_number("the top of a colour scale", top, positive=True)
    mesh = step.scene.mesh
    extent = np.ptp(mesh.points, axis=0).max()
    leaf, face = visible_faces(step.forest, np.asarray(step.record.contact_centre), 10 * extent, cut)
    points, values = _on_faces(step, leaf, face, field, factor)
    points += apart * _outward(mesh)[mesh.body[step.forest.cell[leaf]]][:, None]
    shown, obstacles = on_first(step.forest.comm, points, values), placed_obstacles(step, factor)

    def draw(plotter: "Plotter") -> None:
        """Add all that is shown, on rank 0."""
        points, values = shown
        _draw(plotter, points, values, field, top)
        _look_at(plotter, points.reshape(-1, 3) @ _AXES.T, zoom, _AXES @ np.asarray(step.record.contact_centre))
        add_obstacles(plotter, obstacles, points.reshape(-1, 3))
        if zoom > 1:
            leave_strip(plotter)
        add_length(plotter, step.scene.units)
        name = labelled(_FIELDS[field], "stress", step.scene.units).replace(" [", "\n[")
        add_note(plotter, f"{name}\ndisplacements\nx {factor:g}")

    return draw_on_first(step.forest.comm, path, draw, plotter_for, plotter)


def _on_faces(
    step: Step, leaf: Int64Array, face: Int64Array, field: str, factor: float
) -> tuple[FloatArray, FloatArray]:
    """Displaced points of faces and the field there: (m, (k+1)^2, 3) and (m, (k+1)^2), k = `PIECES`.  Collective."""
    degree = step.record.degree
    finer = face_interpolation(degree, PIECES)
    on_face = leaf[:, None], hexahedron.face_nodes(degree)[face]
    if field == "pressure":
        nodal = nodal_values(step)[:, 3][step.elasticity.prolongation.space.on_faces(leaf, face)]
        on_contact = np.zeros((len(step.forest), 6))
        on_contact[contact_faces(step)] = 1  # other faces may have closed nodes at an edge
        values = on_contact[leaf, face, None] * (nodal @ _bilinear(degree).T)
    else:
        values = von_mises(step.nodal_stress[on_face]) @ finer.T
    return face_points(step.forest, leaf, face) + factor * (finer @ step.nodal_displacement[on_face]), values


def _bilinear(degree: int) -> FloatArray:
    """Bilinear interpolation between the nodes of a face, which keeps the pressure positive: ((k+1)^2, (p+1)^2)."""
    at, nodes = np.linspace(0, 1, PIECES + 1), np.linspace(0, 1, degree + 1)
    hats = np.stack([np.interp(at, nodes, unit) for unit in np.eye(degree + 1)], axis=1)
    return np.kron(hats, hats)


def _outward(mesh: RootMesh) -> FloatArray:
    """Vectors from the centre of all bodies to that of each, by bounding boxes: (bodies, 3) [m]."""
    boxes = [mesh.points[np.unique(mesh.cells[mesh.body == body])] for body in range(len(mesh.bodies))]
    centres = np.array([(box.min(axis=0) + box.max(axis=0)) / 2 for box in boxes])
    return centres - (mesh.points.min(axis=0) + mesh.points.max(axis=0)) / 2


def _draw(plotter: "Plotter", points: FloatArray, values: FloatArray, field: str, top: float | None) -> None:
    surface, edges = surface_and_edges(points)
    pressure, title, values = field == "pressure", _FIELDS[field], values.ravel()
    surface[title] = values
    if top is None:
        top = values.max() if pressure else exceeded(surface, title, _SATURATED)
    if pressure:
        surface[title] = np.where(values > 0, values, -1e-9 * top)  # below the scale: no colour
    place, light = bar(0.5, position_x=0.83, width=0.06), {"ambient": 0.65, "diffuse": 0.4}
    plotter.add_mesh(surface, scalars=title, cmap="viridis", clim=(0, top), scalar_bar_args=place, **light)
    if pressure:
        plotter.mapper.lookup_table.below_range_color = "#e8e8e8"
    nearer = edges.translate(1e-3 * np.ptp(surface.points, axis=0).max() * _AXES[2])  # before the surface
    plotter.add_mesh(nearer, color="black" if pressure else "white", opacity=0.4, line_width=1.5, lighting=False)


def _look_at(plotter: "Plotter", points: FloatArray, zoom: float, about: FloatArray) -> None:
    """Turn the camera to points, magnified to one (3,), all given in the coordinates `_AXES` of the picture."""
    width, height = picture_size(plotter)
    low, high = points.min(axis=0), points.max(axis=0)
    size, centre = high - low, (low + high) / 2
    scale = 0.5 * max(1.2 * size[1], 1.4 * size[0] * height / width) / zoom
    if zoom > 1:
        centre[:2] = about[:2]
    else:
        centre[0] += 0.12 * scale * width / height  # room for the colour bar
    eye = centre + [0, 0, 10 * max(size)]
    plotter.enable_parallel_projection()
    plotter.camera_position = [eye @ _AXES, centre @ _AXES, _AXES[1]]
    plotter.camera.parallel_scale = scale
