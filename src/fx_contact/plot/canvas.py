"""Axes of matplotlib and plotters of pyvista, saved as PNG by rank 0; camera and legends."""

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fx_contact.adaptive.pyvista_grid import import_pyvista
from fx_contact.items.units import Units, unit_of
from fx_contact.parallel.agreement import shared_path
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import OutputError
from fx_contact.parallel.mpi import together

#: Endings of files that matplotlib and pyvista write, and those of matplotlib alone.
_PICTURES, _VECTOR_GRAPHICS = (".png", ".jpg", ".jpeg", ".tif", ".tiff"), (".pdf", ".svg", ".eps", ".ps", ".webp")
#: Share of the width or height that the bodies fill; of half the width: by which they are moved to the left of the
#: legends, and which they have to the right of what is magnified.
_FILLED, _LEFT, _SHOWN = 0.8, 0.2, 0.78


def draw_on_first(
    comm: MPI.Intracomm,
    path: str | Path | None,
    draw: Callable[[Any], None],
    canvas: Callable[[Path], AbstractContextManager[Any]],
    given: Any = None,
) -> Any:
    """Draw a picture on rank 0, on the axes or plotter given there or, with `axes_for` or `plotter_for`, into a file.

    Collective on comm.  Returns what is given, or the path.

    Raises:
        OutputError: the picture cannot be written or its name is that of no picture, or neither a path nor axes nor a
            plotter are given.
    """
    if comm.bcast(given is not None):
        with together(comm):
            if comm.rank == 0:
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
def axes_for(path: Path) -> Iterator[Any]:
    """Axes of a new figure, saved at the end of the `with` block.  Local.  pyplot and its figures are not touched."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    axes = figure.add_subplot()
    axes.spines[["top", "right"]].set_visible(False)
    yield axes
    figure.savefig(path, dpi=150)


@contextmanager
def plotter_for(path: str | Path, width: int = 1200, height: int = 840) -> Iterator[Any]:
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


def look(plotter: Any, eye: npt.ArrayLike, up: npt.ArrayLike = (0, 0, 1)) -> None:
    """Turn the camera to all that is drawn, seen from a direction (3,), and fill the picture.  Local."""
    plotter.enable_parallel_projection()
    plotter.view_vector(eye, viewup=up)
    plotter.renderer.ResetCameraScreenSpace(_FILLED)
    plotter.camera.SetWindowCenter(_LEFT, 0)


def look_at(plotter: Any, centre: FloatArray, half_height: float) -> None:
    """Magnify: move the camera to a point (3,) [m], with half the height of the picture [m].  Local.

    Bodies are cut off where legends begin at the right.
    """
    from vtkmodules.vtkCommonDataModel import vtkPlane

    camera, renderer = plotter.camera, plotter.renderer
    towards = np.array(camera.position) - camera.focal_point
    camera.position, camera.focal_point, camera.parallel_scale = centre + towards, centre, half_height
    right = np.cross(camera.up, towards)
    plane = vtkPlane()
    plane.SetNormal(-right)
    plane.SetOrigin(centre + _SHOWN * half_height * renderer.GetTiledAspectRatio() * right / np.linalg.norm(right))
    for actor in renderer.actors.values():
        if actor.IsA("vtkActor"):  # legends are vtkActor2D
            actor.mapper.AddClippingPlane(plane)
    plotter.reset_camera_clipping_range()


def add_legend(plotter: Any, text: str, units: Units = None) -> None:
    """Write text into the upper right corner, and add a scale bar in the lower left one, for the camera as it is.

    Local.
    """

    def at(x: float, y: float) -> FloatArray:
        """Point of a place in the picture, from -1 to 1, before all bodies."""
        plotter.renderer.SetViewPoint(x, y, 0.0)
        plotter.renderer.ViewToWorld()
        return np.array(plotter.renderer.GetWorldPoint()[:3])

    start, way = at(-0.95, -0.9), at(0.95, -0.9) - at(-0.95, -0.9)
    most = 0.2 * float(np.linalg.norm(way))
    power = 10.0 ** np.floor(np.log10(most))
    length = max(digit for digit in (1, 2, 5) if digit * power <= most) * power
    plotter.add_lines(np.array([start, start + 0.2 * length / most * way]), color="black", width=4)
    label = f"{length:g} {unit_of('length', units)}".rstrip()
    look = {"shape": "rect", "shape_color": "white", "shape_opacity": 0.7, "text_color": "black", "font_size": 18}
    plotter.add_point_labels(at(-0.95, -0.87)[None], [label], show_points=False, always_visible=True, **look)
    plotter.reset_camera_clipping_range()
    size = max(9, plotter.window_size[1] // 64)
    note = plotter.add_text(text, position="upper_right", font_size=size, color="black")
    note.prop.background_color, note.prop.background_opacity = "white", 0.8


def bar(**more: Any) -> dict[str, Any]:
    """`scalar_bar_args` of a vertical bar at the right.  Local."""
    place = {"position_x": 0.85, "position_y": 0.25, "width": 0.08, "height": 0.5, "vertical": True}
    return place | {"title": "", "color": "black", "n_labels": 3, "fmt": "%.3g", "label_font_size": 20} | more


def exceeded(surface: Any, share: float) -> float:
    """Value that the point data "value" exceed on a share of a surface's area.  Local."""
    cells = surface.point_data_to_cell_data().compute_cell_sizes(length=False, volume=False)
    return float(np.quantile(cells["value"], 1 - share, weights=cells["Area"], method="inverted_cdf"))


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
