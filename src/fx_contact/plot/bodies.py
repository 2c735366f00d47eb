"""The deformed bodies in three dimensions, with the contact pressure or the stress on their surfaces."""

import numpy as np

from fx_contact.adaptive.step import check_step
from fx_contact.estimate.stress_recovery import von_mises
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.validation import check_name, check_number
from fx_contact.plot.canvas import add_length, add_note, bar, draw_on_first, exceeded, picture_size, plotter_for
from fx_contact.plot.faces import EYE, PIECES, face_points, surface_and_edges, visible_faces
from fx_contact.problem import hexahedron
from fx_contact.results.contact_surface import face_interpolation, nodal_values

#: What the surfaces can be coloured by, and how it is called in the picture.
_FIELDS = {"pressure": "contact pressure", "stress": "von Mises stress"}
#: From the centre of a picture to the eye: as in other pictures, but from higher up, to look onto lower bodies.
_EYE = EYE + [0, 0, 1.6]
#: Share of a surface whose stress is above the scale: beside edges it grows with every level.
_SATURATED = 0.005


@collective("step.forest.comm")
def draw_bodies(
    step, path=None, field="pressure", *, factor=1.0, apart=0.0, cut=False, zoom=1.0, top=None, plotter=None
):
    """The deformed bodies and their leaves, coloured by contact pressure or by von Mises stress.

    Collective on the step's communicator; rank 0 draws.  Only the faces on the surface are brought together.

    Args:
        step: Step; with contact, if pressure is drawn.
        path: of the PNG, if there is no plotter.
        field: "pressure" or "stress".
        factor: by which displacements are drawn larger.
        apart: how far bodies are moved out of the common centre, relative to how far theirs are from it: 0, not at all.
        cut: whether what is before the plane across y through the contact's centre is left out; leaves are not cut.
        zoom: size of the picture over that which shows all.
        top: of the colour scale [Pa]; None: the largest pressure, or the stress that 0.5 % of the surface exceeds.
        plotter: pyvista Plotter to draw on, that of rank 0; None: a file.

    Returns:
        Path of the picture, or the plotter.

    Raises:
        SceneError: no step, or without contact where pressure is asked for; another field; a number that is none.
        OutputError: the picture cannot be written.
    """
    check_name("field", field, _FIELDS)
    check_step(step, contact=field == "pressure")
    check_number("the zoom of a picture", zoom, positive=True)
    if top is not None:
        check_number("the top of a colour scale", top, positive=True)
    extent = np.ptp(step.scene.mesh.points, axis=0).max()
    leaf, face = visible_faces(step.forest, np.asarray(step.record.contact_centre), 10 * extent, cut)
    points, values = _on_faces(step, leaf, face, field, factor)
    points += apart * _outward(step.scene.mesh)[step.forest.mesh.body[step.forest.cell[leaf]]][:, None]
    parts = step.forest.comm.gather((points, values), root=0)

    def draw(plotter):
        """The picture, on the first rank."""
        points, values = (np.concatenate(column) for column in zip(*parts))
        _draw(plotter, points, values, field, zoom, top)
        add_note(plotter, f"{_FIELDS[field]}\ndisplacements x {factor:g}")

    return draw_on_first(step.forest.comm, path, draw, plotter_for, plotter)


def _on_faces(step, leaf, face, field, factor):
    """Displaced points of faces and the field there: (m, (k+1)^2, 3) and (m, (k+1)^2), k = `PIECES`."""
    degree = step.record.degree
    finer = face_interpolation(degree, PIECES)
    on_face = leaf[:, None], hexahedron.face_nodes(degree)[face]
    if field == "pressure":
        nodal = nodal_values(step)[:, 3][step.elasticity.prolongation.space.on_faces(leaf, face)]
        on_contact = np.zeros((len(step.forest), 6))
        on_contact[step.forest.contact_faces()] = 1  # other faces may have closed nodes at an edge
        values = on_contact[leaf, face, None] * (nodal @ _between_nodes(degree).T)
    else:
        values = von_mises(step.nodal_stress[on_face]) @ finer.T
    return face_points(step.forest, leaf, face) + factor * (finer @ step.nodal_displacement[on_face]), values


def _between_nodes(degree):
    """Bilinear interpolation between the nodes of a face, which makes no pressure below zero: like `finer`."""
    at, nodes = np.linspace(0, 1, PIECES + 1), np.linspace(0, 1, degree + 1)
    along = np.stack([np.interp(at, nodes, unit) for unit in np.eye(degree + 1)], axis=1)
    return np.kron(along, along)


def _outward(mesh):
    """From the centre of all bodies to that of each, boxes around them taken: (bodies, 3) [m]."""
    boxes = [mesh.points[np.unique(mesh.cells[mesh.body == body])] for body in range(len(mesh.bodies))]
    centres = np.array([(box.min(axis=0) + box.max(axis=0)) / 2 for box in boxes])
    return centres - (mesh.points.min(axis=0) + mesh.points.max(axis=0)) / 2


def _draw(plotter, points, values, field, zoom, top):
    surface, edges = surface_and_edges(points)
    pressure, title, values = field == "pressure", _FIELDS[field], values.ravel()
    surface[title] = values
    if top is None:
        top = values.max() if pressure else exceeded(surface, title, _SATURATED)
    if pressure:
        surface[title] = np.where(values > 0, values, -1e-9 * top)  # below the scale: no colour
    scale, light = {"cmap": "viridis", "clim": (0, top)}, {"ambient": 0.65, "diffuse": 0.4}
    plotter.add_mesh(surface, scalars=title, scalar_bar_args=bar(0.5, position_x=0.83, width=0.06), **scale, **light)
    if pressure:
        plotter.mapper.lookup_table.below_range_color = "#e8e8e8"
    axes = np.stack(_directions(_EYE))
    nearer = edges.translate(1e-3 * np.ptp(surface.points, axis=0).max() * axes[2])  # lest they lie in the surface
    plotter.add_mesh(nearer, color="black" if pressure else "white", opacity=0.4, line_width=1.5, lighting=False)
    seen = surface.points @ axes.T
    _look(plotter, seen.min(axis=0), seen.max(axis=0), zoom, axes)


def _directions(eye):
    """Unit vectors to the right, upward and to the eye, of a picture seen from there with z upward."""
    towards = eye / np.linalg.norm(eye)
    right = np.cross([0, 0, 1], towards)
    right /= np.linalg.norm(right)
    return right, np.cross(towards, right), towards


def _look(plotter, low, high, zoom, axes):
    """Turn the camera to a box, given in coordinates of the picture."""
    width, height = picture_size(plotter)
    size, centre = high - low, (low + high) / 2
    scale = 0.5 * max(1.2 * size[1], 1.4 * size[0] * height / width) / zoom
    centre[0] += 0.12 * scale * width / height  # room for the colour bar
    eye = centre + [0, 0, 10 * max(size)]
    plotter.enable_parallel_projection()
    plotter.camera_position = [eye @ axes, centre @ axes, axes[1]]
    plotter.camera.parallel_scale = scale
    add_length(plotter)
