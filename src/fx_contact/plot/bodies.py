"""Leaves in three dimensions: deformed with pressure or stress, undeformed with their rank or level."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fx_contact.adaptive.step import Step, check_step
from fx_contact.estimate.stress_recovery import von_mises
from fx_contact.geometry import hexahedron
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.items.units import labelled
from fx_contact.parallel.arrays import FloatArray, Int64Array
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.validation import check_name, check_number
from fx_contact.plot import canvas, surfaces
from fx_contact.results.contact_surface import contact_faces, nodal_values

#: Fields on the surfaces, and their names in the picture.
_FIELDS = {"pressure": "contact pressure", "stress": "von Mises stress"}
#: Directions to the eye: of leaves around a contact, and of bodies, higher to show lower bodies from above.
_EYE, _HIGHER = np.array([-2.2, -4.0, 1.2]), np.array([-2.2, -4.0, 2.8])
#: Share of the surface with a stress above the scale: singular at edges, its maximum grows with every level.
_SATURATED = 0.005
#: Most numbers in a legend; obstacles are shown so far around the bodies, relative to their extent.
_LISTED, _MARGIN = 16, 0.05


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
    plotter: Any = None,
) -> Any:
    """Deformed bodies and their leaves, coloured by contact pressure or by von Mises stress, and rigid obstacles.

    Collective on the step's communicator; rank 0 draws and receives the faces on the surface only.

    Args:
        path: of the PNG, if no plotter is given.
        field: "pressure" or "stress".
        factor: magnification of the displacements.
        apart: distance by which bodies are moved out of the common centre, relative to that of their own centres from
            it.
        cut: omit the half before the plane across y through the centre of the contact; leaves are not cut.
        zoom: magnification; 1 shows all bodies, with others the centre of the contact is in the middle.
        top: of the colour scale [Pa]; None: the maximum pressure, or the stress exceeded on 0.5 % of the surface.
        plotter: of pyvista, to draw on, the one of rank 0; it or the path is returned.

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
    pressed = field == "pressure"
    mesh, units, centre = step.scene.mesh, step.scene.units, np.asarray(step.record.contact_centre)
    leaf, face = surfaces.visible_faces(step.forest, centre, cut=cut)
    points, values = _on_faces(step, leaf, face, field, factor)
    points += apart * _outward(mesh)[mesh.body[step.forest.cell[leaf]]][:, None]
    shown = canvas.on_first(step.forest.comm, points, values)
    obstacles = surfaces.placed_obstacles(step, factor)

    name = labelled(_FIELDS[field], "stress", units).replace(" [", "\n[")

    def draw(plotter: Any) -> None:
        """Add all that is shown, on rank 0."""
        points, values = shown
        highest = top or (
            values.max() if pressed else canvas.exceeded(surfaces.surface_of(points, values), _SATURATED)
        )
        if pressed:
            values = np.where(values > 0, values, -1e-9 * highest)  # below the scale
        scale = {"clim": (0, highest), "cmap": "viridis", "scalar_bar_args": canvas.bar()}
        _add_faces(plotter, points, values, obstacles, scale, "black" if pressed else "white", 0.4)
        canvas.look(plotter, _HIGHER)
        if zoom != 1:
            canvas.look_at(plotter, centre, plotter.camera.parallel_scale / zoom)
        canvas.add_legend(plotter, f"{name}\ndisplacements\nx {factor:g}", units)

    return canvas.draw_on_first(step.forest.comm, path, draw, canvas.plotter_for, plotter)


@collective("step.forest.comm")
def draw_mesh(
    step: Step, path: str | Path | None = None, zoom: float | None = 3.0, colour: str = "rank", *, plotter: Any = None
) -> Any:
    """Undeformed leaves, coloured, without those before the plane across y through the centre of the contact.

    Rigid obstacles touch them.

    Collective on the step's communicator; rank 0 draws and receives visible faces only.

    Args:
        path: of the PNG, if no plotter is given.
        zoom: half width of the picture, in contact radii, around the contact; None: all bodies.
        colour: "rank" or "level", of refinement.
        plotter: of pyvista, to draw on, the one of rank 0; it or the path is returned.

    Raises:
        SceneError: an unknown colouring, a zoom that is not positive, no step, or with a zoom one without contact.
        OutputError: the picture cannot be written.
    """
    check_step(step, contact=zoom is not None)
    check_name("colouring", colour, ("rank", "level"))
    if zoom is not None:
        check_number("the zoom of a picture", zoom, positive=True)
    forest, centre, units = step.forest, np.asarray(step.record.contact_centre), step.scene.units
    reach = np.inf if zoom is None else zoom * surfaces.contact_size(step)
    leaf, face = surfaces.visible_faces(forest, centre, reach)
    points = surfaces.face_points(forest, leaf, face)
    number = forest.level[leaf] if colour == "level" else np.full(len(leaf), forest.comm.rank)
    shown = canvas.on_first(forest.comm, points, np.repeat(number.astype(int), points.shape[1]))
    obstacles = surfaces.placed_obstacles(step, 0.0)

    def draw(plotter: Any) -> None:
        """Add all that is shown, on rank 0."""
        faces, numbers = shown
        add_numbers(plotter, faces, numbers, colour, obstacles)
        if zoom is not None:
            canvas.look_at(plotter, centre, 0.7 * reach)
        canvas.add_legend(plotter, colour, units)

    return canvas.draw_on_first(forest.comm, path, draw, canvas.plotter_for, plotter)


def add_numbers(
    plotter: Any, faces: FloatArray, numbers: npt.NDArray[Any], word: str, obstacles: Sequence[FloatArray] = ()
) -> None:
    """Add faces coloured by numbers at their points from 0, with their legend, and look at them.  Local."""
    count = max(int(numbers.max(initial=0)) + 1, 2)
    legend = canvas.bar(n_labels=count, fmt="%.0f") if count <= _LISTED else None
    scale = {"clim": (0, count - 1), "cmap": _colours(word, count), "scalar_bar_args": legend}
    _add_faces(plotter, faces, numbers, obstacles, scale, "#202020")
    canvas.look(plotter, _EYE)


def _colours(word: str, count: int) -> list[str]:
    """Colours of the first numbers: of levels from light to dark, of others in turn; the same in all pictures."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    numbers = np.arange(count)
    if word == "level":
        return [to_hex(colour) for colour in colormaps["viridis_r"](0.95 - 0.85 * 0.75**numbers)]
    return [to_hex(colour) for colour in colormaps["tab20"]((2 * numbers + numbers // 10) % 20)]  # dark, then light


def _on_faces(
    step: Step, leaf: Int64Array, face: Int64Array, field: str, factor: float
) -> tuple[FloatArray, FloatArray]:
    """Displaced points of faces and the field there: (m, (k+1)^2, 3) and (m, (k+1)^2), k = `PIECES`.  Collective."""
    degree = step.record.degree
    finer = hexahedron.face_interpolation(degree, surfaces.PIECES)
    on_face = leaf[:, None], hexahedron.face_nodes(degree)[face]
    if field == "pressure":
        nodal = nodal_values(step)[:, 3][step.elasticity.prolongation.space.on_faces(leaf, face)]
        on_contact = np.zeros((len(step.forest), 6))
        on_contact[contact_faces(step)] = 1  # other faces may have closed nodes at an edge
        values = on_contact[leaf, face, None] * (nodal @ hexahedron.bilinear_interpolation(degree, surfaces.PIECES).T)
    else:
        values = von_mises(step.nodal_stress[on_face]) @ finer.T
    points = surfaces.face_points(step.forest, leaf, face)
    return points + factor * (finer @ step.nodal_displacement[on_face]), values


def _outward(mesh: RootMesh) -> FloatArray:
    """Vectors from the centre of all bodies to that of each, by bounding boxes: (bodies, 3) [m]."""
    boxes = [mesh.points[np.unique(mesh.cells[mesh.body == body])] for body in range(len(mesh.bodies))]
    centres = np.array([(box.min(axis=0) + box.max(axis=0)) / 2 for box in boxes])
    return centres - (mesh.points.min(axis=0) + mesh.points.max(axis=0)) / 2


def _add_faces(
    plotter: Any,
    points: FloatArray,
    values: npt.NDArray[Any],
    obstacles: Sequence[FloatArray],
    scale: dict[str, Any],
    edges: str,
    opacity: float = 1.0,
) -> None:
    """Add faces coloured by values at their points, grey below the scale, lines around them, translucent obstacles."""
    surface, lines = surfaces.surface_of(points, values), surfaces.edges_of(points)
    shown = {"show_scalar_bar": scale["scalar_bar_args"] is not None, "ambient": 0.65, "diffuse": 0.4}
    added = plotter.add_mesh(surface, scalars="value", **scale, **shown)
    added.mapper.lookup_table.below_range_color = "#e8e8e8"
    nearer = lines.translate(1e-3 * surface.length / np.linalg.norm(_EYE) * _EYE)  # before the surface
    plotter.add_mesh(nearer, color=edges, opacity=opacity, line_width=1.5, lighting=False)
    low, high = points.min(axis=(0, 1)), points.max(axis=(0, 1))
    margin = _MARGIN * (high - low).max()
    box = np.stack([low - margin, high + margin], axis=1).ravel()
    for part in (surfaces.surface_of(faces).clip_box(box, invert=False) for faces in obstacles):
        if part.n_points:
            plotter.add_mesh(part, color="#8090a0", opacity=0.3)
