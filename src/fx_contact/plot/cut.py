"""Stress in a plane cut through the bodies."""

from functools import partial

import numpy as np
from mpi4py import MPI

from fx_contact.adaptive.pyvista_grid import import_pyvista
from fx_contact.adaptive.step import check_step
from fx_contact.estimate.recovery import von_mises
from fx_contact.fem.leaf_mesh import leaf_positions
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.validation import check_name, check_number
from fx_contact.plot.canvas import add_length, draw_on_first, exceeded, plotter_for
from fx_contact.plot.cells import contact_size
from fx_contact.problem import hexahedron

#: Axes that are shown to the right, away from the viewer and upward, by the axis that a cut is across.
_SHOWN = {"x": [1, 0, 2], "y": [0, 1, 2], "z": [0, 2, 1]}
#: Share of the area whose stress is above the scale: beside edges it grows with every level.
_SATURATED = 0.01


@collective("step.forest.comm")
def draw_stress(step, path=None, zoom=None, across="y", *, plotter=None):
    """Von Mises stress, recovered at the nodes, and the leaves in a plane through the contact's centre.

    Collective on the step's communicator; rank 0 draws.  Only leaves that the plane cuts are brought together.

    Args:
        step: Step, with contact if there is a zoom.
        path: of the PNG, if there is no plotter.
        zoom: half width of the picture, in contact radii; None: all of the bodies.
        across: "x", "y" or "z", the normal of the plane.
        plotter: pyvista Plotter to draw on, that of rank 0; None: a file.

    Returns:
        Path of the picture, or the plotter.

    Raises:
        SceneError: no step, or with a zoom one without contact, a zoom that is not positive, or another axis.
        OutputError: the picture cannot be written.
    """
    check_step(step, contact=zoom is not None)
    if zoom is not None:
        check_number("the zoom of a picture", zoom, positive=True)
    check_name("axis", across, _SHOWN)
    comm, forest, axes = step.forest.comm, step.forest, _SHOWN[across]
    points = leaf_positions(forest, slice(None), step.record.degree)[:, :, axes]
    centre, reach = np.asarray(step.record.contact_centre)[axes], None
    y, depth = centre[1], points[:, :, 1]
    size = np.ptp(depth, axis=1)
    # Slightly beside the plane, so that one between leaves cuts those of one side.
    y += 1e-3 * comm.allreduce(float(size.min(initial=np.inf)), op=MPI.MIN)
    cut = (depth.min(axis=1) <= y) & (depth.max(axis=1) >= y)
    if zoom is not None:
        reach = zoom * contact_size(step)
        cut &= (np.abs(points - centre).min(axis=1) <= 2 * reach).all(axis=1)
    stress = von_mises(step.elasticity.at_leaves(step.estimate.stress)[cut])
    parts = comm.gather((points[cut], stress, forest.mesh.body[forest.cell[cut]]), root=0)

    def draw(plotter):
        """The picture, on the first rank."""
        points, values, body = (np.concatenate(column) for column in zip(*parts))
        _draw_cut(plotter, points, values, body, centre=centre, reach=reach, y=y)

    return draw_on_first(comm, path, draw, partial(plotter_for, width=1500, height=1000), plotter)


def cut_by_body(points, values, body, y):
    """Leaves cut by a plane across y, each body by itself.

    Local.  VTK merges coincident points of a cut: two bodies in contact would share the stress of one.  A leaf of
    degree p is shown by p^3 trilinear cells.

    Args:
        points: (n, (p+1)^3, 3) float64, nodes of leaves, their axes in the order of `_SHOWN` [m].
        values: (n, (p+1)^3) float64, stress there [Pa].
        body: (n,) int, body of each leaf.
        y: place of the plane [m].

    Returns:
        list of pyvista PolyData with point values "stress", one for each body that the plane cuts.
    """
    pyvista = import_pyvista()
    sections, parts = [], hexahedron.subcells(hexahedron.order_of(points.shape[1]))[:, [0, 1, 3, 2, 4, 5, 7, 6]]
    for which in np.unique(body):
        ours = body == which
        cells = (points.shape[1] * np.arange(ours.sum())[:, None, None] + parts).reshape(-1, 8)
        grid = pyvista.UnstructuredGrid({pyvista.CellType.HEXAHEDRON: cells}, points[ours].reshape(-1, 3))
        grid["stress"] = values[ours].ravel()
        sections.append(grid.slice(normal=(0, 1, 0), origin=(0, y, 0)))
    return sections


def _draw_cut(plotter, points, values, body, *, centre, reach, y):
    pyvista = import_pyvista()
    section = pyvista.merge(cut_by_body(points, values, body, y), merge_points=False)
    plotter.add_mesh(
        section,
        scalars="stress",
        cmap="viridis",
        clim=(0, exceeded(section, "stress", _SATURATED)),
        lighting=False,
        scalar_bar_args={
            "title": "von Mises stress; 1 % of the area is above the scale",
            "color": "black",
            "fill": reach is not None,
            "background_color": "white",
            "vertical": False,
            "n_labels": 2,
            "position_x": 0.2,
            "title_font_size": 22,
            "fmt": "%.2g",
        },
    )
    plotter.add_mesh(_outlines(points, y), color="#202020", line_width=2, lighting=False)
    plotter.enable_parallel_projection()
    plotter.view_xz()
    if reach is None:
        x, z = np.ptp(points[:, :, [0, 2]], axis=(0, 1))
        plotter.camera.parallel_scale = 0.6 * max(z, x / 1.5)
    else:
        quarter = points[:, :, 0].min() >= centre[0] - 1e-9 * reach  # else half of the picture would be empty
        plotter.camera.focal_point = centre + [reach * quarter, 0, 0]
        plotter.camera.position = np.array(plotter.camera.focal_point) - [0, 10 * reach, 0]
        plotter.camera.parallel_scale = 0.7 * reach
    lower = np.array([0, 0, 0.08 * plotter.camera.parallel_scale])  # room for the scale
    plotter.camera.focal_point, plotter.camera.position = (
        np.array(place) - lower for place in (plotter.camera.focal_point, plotter.camera.position)
    )
    add_length(plotter)


def _outlines(points, y):
    """The lines in which a plane across y cuts the faces of leaves."""
    pyvista = import_pyvista()
    order = hexahedron.order_of(points.shape[1])
    quads = points[:, hexahedron.face_nodes(order)[:, hexahedron.subcells(order, 2)[:, [0, 1, 3, 2]]]].reshape(
        -1, 4, 3
    )
    quads = quads[(quads[:, :, 1].min(axis=1) <= y) & (quads[:, :, 1].max(axis=1) >= y)]
    faces = np.arange(4 * len(quads)).reshape(-1, 4)
    skin = pyvista.PolyData.from_regular_faces(quads.reshape(-1, 3), faces)
    return skin.slice(normal=(0, 1, 0), origin=(0, y, 0))
