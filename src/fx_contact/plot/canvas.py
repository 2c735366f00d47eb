"""Axes of matplotlib and plotters of pyvista, saved as PNG by rank 0."""

import os
import shutil
import subprocess
from contextlib import contextmanager

import numpy as np

from fx_contact.adaptive.pyvista_grid import import_pyvista
from fx_contact.parallel.agreement import shared_path
from fx_contact.parallel.errors import OutputError
from fx_contact.parallel.mpi import together


def draw_on_first(comm, path, draw, canvas, given=None):
    """Draw a picture on rank 0: on what the user gives there, or into a file, whose folder is made.

    Collective on comm.

    Args:
        comm: MPI communicator.
        path: of the PNG; not looked at where the user gives axes or a plotter.
        draw: function that draws on axes or a plotter, called on rank 0 alone.
        canvas: context manager of a path that yields axes or a plotter and saves them: `axes_for` or `plotter_for`.
        given: matplotlib Axes or pyvista Plotter of the user, or None; that of rank 0 counts.

    Returns:
        What is given, or else the Path of the picture.

    Raises:
        OutputError: the picture cannot be written, or there is neither a path nor what to draw on.
    """
    if comm.bcast(given is not None):
        with together(comm):
            if comm.rank == 0:
                draw(given)
        return given
    path = shared_path(comm, "the name of a picture", path, OutputError)
    if not path.suffix:  # what draws would give it one, and the picture would be elsewhere
        raise OutputError(
            f"the name of a picture must end in .png, got {str(path)!r}: if this is a folder, name a file"
        )
    with together(comm):
        if comm.rank == 0:
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                with canvas(path) as new:
                    draw(new)
            except ValueError as error:
                raise OutputError(f"cannot draw {str(path)!r}, let its name end in .png: {error}") from error
            except OSError as error:
                raise OutputError(f"cannot draw {str(path)!r}: {error}; name another output folder") from error
    return path


@contextmanager
def axes_for(path, width=6.4, height=4.4):
    """Axes of a figure that is saved in the end.

    Local.  Without pyplot, so that figures of a notebook or of another program are left alone.

    Args:
        path: of the PNG.
        width, height: of the figure [inches].
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.add_subplot()
    axes.spines[["top", "right"]].set_visible(False)
    yield axes
    figure.savefig(path, dpi=150)


@contextmanager
def plotter_for(path, width=1200, height=840):
    """A pyvista Plotter whose picture is saved in the end; without a display it starts a virtual one, Xvfb.

    Local.  For a `with` block, of one rank:

        with plotter_for("x.png") as plotter:
            plotter.add_mesh(step.to_pyvista(), scalars="von Mises stress")

    Args:
        path: of the PNG, in a folder that is there.
        width, height: of the picture [pixels].
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


def picture_size(plotter):
    """Width and height of the picture, or of the present one of several, of a pyvista Plotter [pixels].  Local."""
    x0, y0, x1, y1 = plotter.renderer.GetViewport()
    return np.array(plotter.window_size) * [x1 - x0, y1 - y0]


def add_length(plotter):
    """Lay a scale of length into the lower left corner, for a camera that looks in parallel.  Local.

    Args:
        plotter: pyvista Plotter with its camera in place.
    """
    camera, (width, height) = plotter.camera, picture_size(plotter)
    scale, focus = camera.parallel_scale, np.array(camera.focal_point)
    towards = camera.position - focus
    right = np.cross(camera.up, towards)
    right /= np.linalg.norm(right)
    up = np.cross(towards, right) / np.linalg.norm(towards)
    power = 10.0 ** np.floor(np.log10(0.4 * scale))
    length = max(digit for digit in (1, 2, 5) if digit * power <= 0.4 * scale) * power
    start = focus + towards / 2 - 0.92 * scale * (width / height * right + up)  # before all bodies
    plotter.add_lines(np.array([start, start + length * right]), color="black", width=4)
    text = {"shape": "rect", "shape_color": "white", "shape_opacity": 0.7, "text_color": "black", "font_size": 18}
    above = start + 0.03 * scale * up
    plotter.add_point_labels(above[None], [f"{length:g}"], show_points=False, always_visible=True, **text)
    plotter.reset_camera_clipping_range()


def bar(height, **more):
    """What pyvista is told of a colour bar at the right, black numbers beside it: dict, `scalar_bar_args`.  Local.

    Args:
        height: share of the picture's.
        more: further entries.
    """
    place = {"position_x": 0.85, "position_y": 0.5 - height / 2, "width": 0.13, "height": height}
    text = {"title": "", "color": "black", "n_labels": 3, "fmt": "%.3g", "label_font_size": 18}
    return {"vertical": True, "background_color": "white", **place, **text} | more


def add_note(plotter, text):
    """Write black on white into the upper right corner.  Local.

    Args:
        plotter: pyvista Plotter.
        text: str, of some lines.
    """
    width, height = picture_size(plotter)
    size = max(9, int(height / 64))
    place = (0.98 * width, 0.97 * height - 2.6 * size * len(text.splitlines()))
    note = plotter.add_text(text, place, font_size=size, color="black")
    note.prop.justification_horizontal = "right"
    note.prop.background_color, note.prop.background_opacity = "white", 0.8


def exceeded(surface, name, share):
    """The value that a share of a surface's area exceeds.

    Local.

    Args:
        surface: pyvista PolyData with point values of a name.
        name: of the values.
        share: of the area, in [0, 1].

    Returns:
        float, in the unit of the values.
    """
    cells = surface.point_data_to_cell_data().compute_cell_sizes(length=False, volume=False)
    order = np.argsort(cells[name])[::-1]
    area = cells["Area"][order].cumsum()
    return cells[name][order][np.searchsorted(area, share * area[-1])]


@contextmanager
def _display():
    """An X display for pyvista: the present one, or else a virtual one."""
    if os.environ.get("DISPLAY") or shutil.which("Xvfb") is None:
        yield
        return
    read, write = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write), "-screen", "0", "1600x1200x24", "-nolisten", "tcp"],
        pass_fds=[write],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(write)
    with os.fdopen(read) as answer:
        os.environ["DISPLAY"] = ":" + answer.readline().strip()
    try:
        yield
    finally:
        del os.environ["DISPLAY"]
        server.terminate()
        server.wait()
