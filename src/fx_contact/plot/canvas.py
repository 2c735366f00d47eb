"""Axes of matplotlib and plotters of pyvista, saved as PNG by rank 0."""

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fx_contact.adaptive.pyvista_grid import import_pyvista
from fx_contact.items.units import Units, unit_of
from fx_contact.parallel.agreement import shared_path
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import OutputError
from fx_contact.parallel.mpi import together

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pyvista import Plotter, PolyData

Canvas = TypeVar("Canvas")

#: Endings of files that matplotlib and pyvista write, and those of matplotlib alone.
_PICTURES, _VECTOR_GRAPHICS = (".png", ".jpg", ".jpeg", ".tif", ".tiff"), (".pdf", ".svg", ".eps", ".ps", ".webp")


def draw_on_first(
    comm: MPI.Intracomm,
    path: str | Path | None,
    draw: Callable[[Canvas], None],
    canvas: Callable[[Path], AbstractContextManager[Canvas]],
    given: Canvas | None = None,
) -> Path | Canvas | None:
    """Draw a picture on rank 0, on the axes or plotter given there or, with `axes_for` or `plotter_for`, into a file.

    Collective on comm.

    Raises:
        OutputError: the picture cannot be written or its name is that of no picture, or neither a path nor axes nor a
            plotter are given.
    """
    if comm.bcast(given is not None):
        with together(comm):
            if comm.rank == 0:
                assert given is not None
                draw(given)
        return given
    path = shared_path(comm, "the name of a picture", path, OutputError)
    if path.suffix not in _PICTURES + _VECTOR_GRAPHICS * (canvas is axes_for):
        raise OutputError(
            f"the name of a picture must end in .png, got {str(path)!r}: if this is a folder, name a file"
        )
    with together(comm):
        if comm.rank == 0:
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                with canvas(path) as new:
                    draw(new)
            except OSError as error:
                raise OutputError(f"cannot draw {str(path)!r}: {error}; name another output folder") from error
    return path


def on_first(comm: MPI.Intracomm, *arrays: npt.NDArray[Any]) -> list[npt.NDArray[Any]]:
    """Arrays of all ranks, concatenated, on rank 0; on other ranks an empty list.  Collective on comm."""
    parts = comm.gather(arrays)
    return [np.concatenate(column) for column in zip(*(parts or ()))]


@contextmanager
def axes_for(path: Path) -> "Iterator[Axes]":
    """Axes of a new figure, saved at the end of the `with` block.  Local.  pyplot and its figures are not touched."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    axes = figure.add_subplot()
    axes.spines[["top", "right"]].set_visible(False)
    yield axes
    figure.savefig(path, dpi=150)


@contextmanager
def plotter_for(path: str | Path, width: int = 1200, height: int = 840) -> "Iterator[Plotter]":
    """A pyvista Plotter whose picture is saved at the end of the `with` block, in an existing folder.

    Local.  Width and height are in pixels.  Without a display a virtual one, Xvfb, is started.

        with plotter_for("x.png") as plotter:
            plotter.add_mesh(step.to_pyvista(), scalars="von Mises stress")
    """
    with _display():
        plotter = import_pyvista().Plotter(off_screen=True, window_size=(width, height))
        plotter.set_background("white")
        plotter.enable_anti_aliasing("ssaa")
        try:
            yield plotter
            plotter.screenshot(path)
        finally:
            plotter.close()  # before its display ends, or X ends the process


def picture_size(plotter: "Plotter") -> FloatArray:
    """Width and height [pixels] of the picture, or of the active subplot.  Local."""
    x0, y0, x1, y1 = plotter.renderer.GetViewport()
    return np.array(plotter.window_size) * np.array([x1 - x0, y1 - y0])


def view_axes(towards: FloatArray, up: FloatArray) -> FloatArray:
    """Unit vectors, the rows of (3, 3), to the right, upward and to the eye, with a direction (3,) upward.  Local."""
    right = np.cross(up, towards)
    axes = np.stack([right, np.cross(towards, right), towards])
    return axes / np.linalg.norm(axes, axis=1)[:, None]


def leave_strip(plotter: "Plotter", share: float = 0.22) -> None:
    """Leave a share of the picture's width at the right to legends: all is moved to the left, and cut off there.

    Local.  For the present camera and parallel projection.
    """
    from vtkmodules.vtkCommonDataModel import vtkPlane

    camera, (width, height) = plotter.camera, picture_size(plotter)
    focus, eye = np.array(camera.focal_point), np.array(camera.position)
    right = view_axes(eye - focus, np.array(camera.up))[0] * camera.parallel_scale * width / height
    camera.focal_point, camera.position = focus + share * right, eye + share * right
    plane = vtkPlane()
    plane.SetOrigin(focus + (1 - share) * right)
    plane.SetNormal(-right)
    for actor in plotter.renderer.actors.values():
        if actor.IsA("vtkActor"):  # legends are vtkActor2D
            actor.GetMapper().AddClippingPlane(plane)


def add_length(plotter: "Plotter", units: Units = None) -> None:
    """Add a scale bar in the lower left corner, for the present camera and parallel projection.  Local."""
    camera, (width, height) = plotter.camera, picture_size(plotter)
    scale, focus = camera.parallel_scale, np.array(camera.focal_point)
    towards = np.array(camera.position) - focus
    right, up, _ = view_axes(towards, np.array(camera.up))
    power = 10.0 ** np.floor(np.log10(0.4 * scale))
    length = max(digit for digit in (1, 2, 5) if digit * power <= 0.4 * scale) * power
    start = focus + towards / 2 - 0.92 * scale * (width / height * right + up)  # before all bodies
    plotter.add_lines(np.array([start, start + length * right]), color="black", width=4)
    text = {"shape": "rect", "shape_color": "white", "shape_opacity": 0.7, "text_color": "black", "font_size": 18}
    above = start + 0.03 * scale * up
    label = f"{length:g} {unit_of('length', units)}".rstrip()
    plotter.add_point_labels(above[None], [label], show_points=False, always_visible=True, **text)
    plotter.reset_camera_clipping_range()


def bar(height: float, **more: Any) -> dict[str, Any]:
    """`scalar_bar_args` of a vertical bar at the right, of a height relative to the picture's.  Local."""
    place = {"position_x": 0.85, "position_y": 0.5 - height / 2, "width": 0.13, "height": height}
    text = {"title": "", "color": "black", "n_labels": 3, "fmt": "%.3g", "label_font_size": 18}
    return {"vertical": True, "background_color": "white", **place, **text} | more


def add_note(plotter: "Plotter", text: str) -> None:
    """Write text into the upper right corner, black on white.  Local."""
    size = max(9, int(picture_size(plotter)[1] / 64))
    note = plotter.add_text(text, position="upper_right", font_size=size, color="black")
    note.prop.background_color, note.prop.background_opacity = "white", 0.8


def exceeded(surface: "PolyData", name: str, share: float) -> float:
    """Value that point data of a name exceed on a share of a surface's area.  Local."""
    cells = surface.point_data_to_cell_data().compute_cell_sizes(length=False, volume=False)
    return float(np.quantile(cells[name], 1 - share, weights=cells["Area"], method="inverted_cdf"))


@contextmanager
def _display() -> Iterator[None]:
    if os.environ.get("DISPLAY") or shutil.which("Xvfb") is None:
        yield
        return
    read, write = os.pipe()
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", "1600x1200x24", "-nolisten", "tcp"]
    null = subprocess.DEVNULL
    server = subprocess.Popen(command, pass_fds=[write], stdout=null, stderr=null)
    os.close(write)
    with os.fdopen(read) as answer:
        os.environ["DISPLAY"] = ":" + answer.readline().strip()
    try:
        yield
    finally:
        del os.environ["DISPLAY"]
        server.terminate()
        server.wait()
