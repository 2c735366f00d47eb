"""Von Mises stress in a plane section of the bodies."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from mpi4py import MPI

from fx_contact.adaptive.pyvista_grid import import_pyvista
from fx_contact.adaptive.step import Step, check_step
from fx_contact.estimate.stress_recovery import von_mises
from fx_contact.fem.leaf_mesh import leaf_positions
from fx_contact.geometry import hexahedron
from fx_contact.items.units import labelled, unit_of
from fx_contact.parallel.arrays import FloatArray, IntArray
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
)
from fx_contact.plot.cells import contact_size

if TYPE_CHECKING:
    from pyvista import Plotter, PolyData

#: Axes to the right, away from the viewer and upward, by the normal of the section.
_SHOWN = {"x": [1, 0, 2], "y": [0, 1, 2], "z": [0, 2, 1]}
#: Share of the area with a stress above the scale: singular at edges, its maximum grows with every level.
_SATURATED = 0.01
#: Share of the width that zoomed views leave to the legend.
_STRIP = 0.22


@collective("step.forest.comm")
def draw_stress(
    step: Step,
    path: str | Path | None = None,
    zoom: float | None = None,
    across: str = "y",
    *,
    plotter: "Plotter | None" = None,
) -> "Path | Plotter | None":
    """Von Mises stress and leaves in a plane through the centre of the contact.

    Collective on the step's communicator; rank 0 draws and receives only the leaves that the plane cuts.

    Args:
        path: of the PNG, if no plotter is given.
        zoom: half width of the picture, in contact radii; None: all bodies.
        across: "x", "y" or "z", the normal of the plane.
        plotter: to draw on, the one of rank 0; it or the path is returned.

    Raises:
        SceneError: no step, or one without contact if a zoom is given; a zoom that is not positive, or another axis.
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
    # A plane between leaves is shifted to cut those on one side of it.
    y += 1e-3 * comm.allreduce(float(size.min(initial=np.inf)), op=MPI.MIN)
    cut = (depth.min(axis=1) <= y) & (depth.max(axis=1) >= y)
    if zoom is not None:
        reach = zoom * contact_size(step)
        cut &= (np.abs(points - centre).min(axis=1) <= 2 * reach).all(axis=1)
    stress = von_mises(step.nodal_stress[cut])
    shown = on_first(comm, points[cut], stress, forest.mesh.region[forest.cell[cut]])

    units = step.scene.units

    def draw(plotter: "Plotter") -> None:
        """The sections with their legend."""
        _draw_cut(plotter, *shown, centre=centre, reach=reach, y=y)
        if zoom is not None:
            leave_strip(plotter, _STRIP)
        add_length(plotter, units)
        name, unit = labelled("von Mises stress", "stress", units).replace(" [", "\n["), unit_of("length", units)
        plane = f"at {across} = {f'{centre[1]:.3g} {unit}'.rstrip()},\nundeformed"
        add_note(plotter, f"{name}\n{plane}\n{_SATURATED:.0%} of the area is\nabove the scale")

    return draw_on_first(comm, path, draw, partial(plotter_for, width=1500, height=1000), plotter)


def cut_by_region(points: FloatArray, values: FloatArray, region: IntArray, y: float) -> "list[PolyData]":
    """Sections in a plane across y [m], one for each body or part in it, with the point data "stress".

    Local.  VTK merges coincident points of a section, which would mix stresses that jump.  Values (n, (p+1)^3) [Pa] at
    nodes (n, (p+1)^3, 3) [m] are shown in p^3 trilinear cells for each of n leaves.
    """
    pyvista = import_pyvista()
    sections, parts = [], hexahedron.subcells(hexahedron.order_of(points.shape[1]))[:, [0, 1, 3, 2, 4, 5, 7, 6]]
    for number in np.unique(region):
        ours = region == number
        cells = (points.shape[1] * np.arange(ours.sum())[:, None, None] + parts).reshape(-1, 8)
        grid = pyvista.UnstructuredGrid({pyvista.CellType.HEXAHEDRON: cells}, points[ours].reshape(-1, 3))
        grid["stress"] = values[ours].ravel()
        sections.append(grid.slice(normal=(0, 1, 0), origin=(0, y, 0)))
    return sections


def _draw_cut(
    plotter: "Plotter",
    points: FloatArray,
    values: FloatArray,
    region: IntArray,
    *,
    centre: FloatArray,
    reach: float | None,
    y: float,
) -> None:
    section = import_pyvista().merge(cut_by_region(points, values, region, y), merge_points=False)
    focus, half = _window(points, centre, reach)
    width, height = picture_size(plotter)
    shown = np.abs(section.cell_centers().points - focus) <= half * np.array([width / height, np.inf, 1])
    top = exceeded(section.extract_cells(shown.all(axis=1)), "stress", _SATURATED)
    scale = {"clim": (0, top), "cmap": "viridis", "scalar_bar_args": bar(0.5, fill=True, label_font_size=26)}
    plotter.add_mesh(section, scalars="stress", lighting=False, **scale)
    plotter.add_mesh(_outlines(points, y), color="#202020", line_width=2, lighting=False)
    plotter.enable_parallel_projection()
    plotter.view_xz()
    plotter.camera.focal_point, plotter.camera.position = focus, focus - [0, 10 * half, 0]
    plotter.camera.parallel_scale = half


def _window(points: FloatArray, centre: FloatArray, reach: float | None) -> tuple[FloatArray, float]:
    """Centre and half height of a picture of all leaves, or of those near a centre, with room for the scales."""
    low, high = points.min(axis=(0, 1)), points.max(axis=(0, 1))
    if reach is None:
        half = 0.6 * max(high[2] - low[2], high[0] - low[0])
        return (low + high) / 2 + [0.2 * half, 0, -0.1 * half], half
    quarter = low[0] >= centre[0] - 1e-9 * reach  # else half of the picture would be empty
    return centre + [reach * quarter, 0, 0], 0.7 * reach / (1 - _STRIP)


def _outlines(points: FloatArray, y: float) -> "PolyData":
    """Lines in which a plane across y cuts the faces of leaves."""
    pyvista = import_pyvista()
    order = hexahedron.order_of(points.shape[1])
    corners = hexahedron.face_nodes(order)[:, hexahedron.subcells(order, 2)[:, [0, 1, 3, 2]]]
    quads = points[:, corners].reshape(-1, 4, 3)
    quads = quads[(quads[:, :, 1].min(axis=1) <= y) & (quads[:, :, 1].max(axis=1) >= y)]
    faces = np.arange(4 * len(quads)).reshape(-1, 4)
    skin = pyvista.PolyData.from_regular_faces(quads.reshape(-1, 3), faces)
    return skin.slice(normal=(0, 1, 0), origin=(0, y, 0))
