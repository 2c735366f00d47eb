"""Von Mises stress in a plane section of the bodies."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from fx_contact.adaptive.pyvista_grid import import_pyvista
from fx_contact.adaptive.step import Step, check_step
from fx_contact.items.units import labelled, unit_of
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.validation import check_name, check_number
from fx_contact.plot import canvas
from fx_contact.plot.surfaces import contact_size

#: Direction to the eye, and upward, by the normal of the section.
_VIEWS = {"x": ((1, 0, 0), (0, 0, 1)), "y": ((0, -1, 0), (0, 0, 1)), "z": ((0, 0, 1), (0, 1, 0))}
#: Share of the area with a stress above the scale: singular at edges, its maximum grows with every level.
_SATURATED = 0.01


@collective("step.forest.comm")
def draw_stress(
    step: Step, path: str | Path | None = None, zoom: float | None = None, across: str = "y", *, plotter: Any = None
) -> Any:
    """Von Mises stress and leaves in a plane through the centre of the contact.

    Collective on the step's communicator; rank 0 draws and receives only the section.

    Args:
        path: of the PNG, if no plotter is given.
        zoom: half width of what is shown around the contact, in contact radii; None: all bodies.
        across: "x", "y" or "z", the normal of the plane.
        plotter: of pyvista, to draw on, the one of rank 0; it or the path is returned.

    Raises:
        SceneError: no step, or one without contact if a zoom is given; a zoom that is not positive, or another axis.
        OutputError: the picture cannot be written.
    """
    check_step(step, contact=zoom is not None)
    if zoom is not None:
        check_number("the zoom of a picture", zoom, positive=True)
    check_name("axis", across, _VIEWS)
    comm, units, axis = step.forest.comm, step.scene.units, "xyz".index(across)
    centre, right = np.array(step.record.contact_centre), int(axis == 0)
    reach = np.inf if zoom is None else zoom * contact_size(step)
    parts = comm.gather(_section(step, centre, 2 * reach, axis))
    name, unit = labelled("von Mises stress", "stress", units).replace(" [", "\n["), unit_of("length", units)
    plane = f"at {across} = {f'{centre[axis]:.3g} {unit}'.rstrip()},\nundeformed"
    if zoom is not None and step.scene.mesh.points[:, right].min() >= centre[right] - 1e-9 * reach:
        centre[right] += 0.9 * reach  # else half of the picture would be empty

    def draw(plotter: Any) -> None:
        """The section with its legend."""
        stressed, lines = ([mesh for part in parts or () for mesh in part[side]] for side in (0, 1))
        section = import_pyvista().merge(stressed, merge_points=False)
        shown = (np.abs(section.cell_centers().points - centre) <= reach).all(axis=1)
        scale = {"clim": (0, canvas.exceeded(section.extract_cells(shown), _SATURATED)), "cmap": "viridis"}
        bar = canvas.bar(label_font_size=26)
        plotter.add_mesh(section, scalars="value", lighting=False, scalar_bar_args=bar, **scale)
        plotter.add_mesh(import_pyvista().merge(lines), color="#202020", line_width=2, lighting=False)
        canvas.look(plotter, *_VIEWS[across])
        if zoom is not None:
            canvas.look_at(plotter, centre, 0.7 * reach)
        canvas.add_legend(plotter, f"{name}\n{plane}\n{_SATURATED:.0%} of the area is\nabove the scale", units)

    return canvas.draw_on_first(comm, path, draw, partial(canvas.plotter_for, width=1500, height=1000), plotter)


def _section(step: Step, centre: FloatArray, reach: float, axis: int) -> tuple[list[Any], list[Any]]:
    """This rank's section across an axis, with point data "value", and the outlines of its leaves.  Collective.

    Both are lists of PolyData of the leaves within a reach of the centre [m]: an element for each body or part, as VTK
    merges coincident points of a section, which would mix stresses that jump.
    """
    grid = step.to_pyvista()
    stress, region = grid["von Mises stress"], grid["region"]
    grid.clear_data()
    grid["value"] = stress
    corners = grid.points[grid.cells.reshape(-1, (step.record.degree + 1) ** 3 + 1)[:, 1:]]
    low, high, origin = corners.min(axis=1), corners.max(axis=1), centre.copy()
    # A plane between leaves is shifted to cut those on one side of it.
    size = step.forest.comm.allreduce(float((high - low)[:, axis].min(initial=np.inf)), op=MPI.MIN)
    origin[axis] += 1e-3 * size
    near = ((low <= centre + reach) & (high >= centre - reach)).all(axis=1)
    near &= (low[:, axis] <= origin[axis]) & (high[:, axis] >= origin[axis])
    sections, outlines = [], []
    for number in np.unique(region[near]):
        cells = grid.extract_cells(near & (region == number))
        faces = cells.separate_cells().extract_surface(nonlinear_subdivision=2)
        sections.append(cells.slice(normal=np.eye(3)[axis], origin=origin))
        outlines.append(faces.slice(normal=np.eye(3)[axis], origin=origin))
    return sections, outlines
