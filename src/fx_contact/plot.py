"""Pictures of a step; plotting libraries are imported only when one is drawn."""

import colorsys
import os
import shutil
import subprocess
from contextlib import contextmanager

import numpy as np
from mpi4py import MPI

from fx_contact import reference
from fx_contact._mpi import together
from fx_contact.errors import OutputError
from fx_contact.lattice import SIDE

#: Ten colours that differ in hue and lightness (Okabe and Ito, then paler ones), for ranks.
RANK_COLOURS = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#CC79A7",
    "#56B4E9",
    "#D55E00",
    "#F0E442",
    "#999999",
    "#A6CEE3",
    "#B2DF8A",
)


def draw_pressure(step, path, exact=None):
    """Contact pressure of every node pair over the radius, against Hertz's.

    Collective on the step's communicator; rank 0 draws.

    Args:
        step: Step with contact.
        path: of the PNG.
        exact: Hertz, or None for no curve.

    Raises:
        OutputError: the picture cannot be written.
    """
    pairs, comm = step.pairs, step.forest.comm
    arm = pairs.position - step.scene.contact_centre
    along = np.einsum("ni,ni->n", arm, pairs.normal)
    radius = np.sqrt(np.maximum((arm**2).sum(axis=1) - along**2, 0))
    near = radius <= 1.6 * step.record["contact_radius"]
    rows = np.stack([radius, step.contact.force / pairs.area], axis=1)[near]
    rows = comm.gather(rows, root=0)
    with together(comm):
        if comm.rank == 0:
            _writing(path, lambda: _draw_pressure(np.concatenate(rows), step.record, path, exact))


def _draw_pressure(rows, record, path, exact):
    plt = _matplotlib()
    figure, axes = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
    scale = exact.contact_radius if exact else 1.0
    axes.plot(rows[:, 0] / scale, rows[:, 1], "o", ms=4, mfc="none", color="#0072B2", label="node pairs")
    if exact:
        r = np.linspace(0, 1.6 * record["contact_radius"], 400)
        axes.plot(r / scale, exact.pressure(r), color="#D55E00", lw=1.6, label=f"Hertz, F = {exact.force:.4g} N")
    axes.set_xlabel("radius / Hertz's contact radius" if exact else "radius [m]")
    axes.set_ylabel("contact pressure [Pa]")
    axes.set_ylim(bottom=0)
    axes.set_xlim(left=0)
    axes.set_title(f"{record['dofs']:,} dofs, estimated error {100 * record['estimate']:.1f} %", fontsize=11)
    axes.legend(frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=150)
    plt.close(figure)


def draw_mesh(step, path, zoom=3.0):
    """The undeformed leaves around the contact, cut open along y = 0 and coloured by rank.

    Collective on the step's communicator; rank 0 draws.  Only faces that can be seen are brought together.

    Args:
        step: Step with contact.
        path: of the PNG.
        zoom: half width of the picture, in contact radii.

    Raises:
        OutputError: the picture cannot be written.
    """
    comm, centre = step.forest.comm, np.asarray(step.scene.contact_centre)
    shown = step.contact.active if step.record["active_pairs"] else np.ones(len(step.pairs), dtype=bool)
    size = float(np.sqrt(step.pairs.area[shown].max(initial=0.0)))
    reach = zoom * max(step.record["contact_radius"], comm.allreduce(size, op=MPI.MAX))
    faces = comm.gather(_visible_faces(step.forest, centre, reach)[0], root=0)
    with together(comm):
        if comm.rank == 0:
            colours = [RANK_COLOURS[rank % len(RANK_COLOURS)] for rank in range(comm.size)]
            legend = [[f"rank {rank}", colour] for rank, colour in enumerate(colours)]
            with _display():
                _writing(path, lambda: _draw_faces(faces, colours, legend, centre, reach, path))


def draw_parts(forest, part, centre, reach, path):
    """The leaves of a forest on one rank around a point, as `draw_mesh` shows them, coloured by part.

    Local.

    Args:
        forest: Forest, all of it on this rank.
        part: (n,) int, part of each leaf.
        centre: (3,) point [m].
        reach: half width of the picture [m].
        path: of the PNG.

    Raises:
        OutputError: the picture cannot be written.
    """
    faces, leaf = _visible_faces(forest, np.asarray(centre), reach)
    shown, count = part[leaf], int(part.max()) + 1
    # Golden steps round the circle of hues: parts of near numbers differ most.
    hues = np.arange(count) * 0.618034 % 1.0
    colours = [colorsys.hsv_to_rgb(h, 0.45 + 0.4 * (i % 2), 0.95 - 0.25 * (i // 2 % 2)) for i, h in enumerate(hues)]
    with _display():
        _writing(
            path, lambda: _draw_faces([faces[shown == p] for p in range(count)], colours, [], centre, reach, path)
        )


def draw_stress(step, path):
    """Von Mises stress, recovered at the vertices, and the leaves in the plane across y through the contact's centre.

    Collective on the step's communicator; rank 0 draws.  Only leaves that the plane cuts are brought together.

    Args:
        step: Step with contact.
        path: of the PNG.

    Raises:
        OutputError: the picture cannot be written.
    """
    comm, forest, y = step.forest.comm, step.forest, step.scene.contact_centre[1]
    leaf, stress = step.leaf_mesh.leaf, step.estimate.stress
    corners = forest.mesh.evaluate(forest.cell, forest.corners[:, [0, 7]].swapaxes(1, 2) / SIDE)[leaf]
    size = np.ptp(corners[:, :, 1], axis=1)
    # Beside the plane by little, so that a plane between leaves cuts those of one side.
    y += 1e-3 * comm.allreduce(float(size.min(initial=np.inf)), op=MPI.MIN)
    cut = (corners[:, :, 1].min(axis=1) <= y) & (corners[:, :, 1].max(axis=1) >= y)
    values = stress.x.array.reshape(-1, 6)[stress.function_space.dofmap.list[cut]]
    body = forest.mesh.body[forest.cell[leaf[cut]]]
    parts = comm.gather((corners[cut], _von_mises(values), body), root=0)
    with together(comm):
        if comm.rank == 0:
            corners, values, body = (np.concatenate(column) for column in zip(*parts))
            with _display():
                _writing(path, lambda: _draw_cut(corners, values, body, y, path))


def _von_mises(stress):
    """Of stresses (..., 6) in the order of `estimate.VOIGT`."""
    x, y, z, yz, xz, xy = np.moveaxis(stress, -1, 0)
    return np.sqrt(((x - y) ** 2 + (y - z) ** 2 + (z - x) ** 2) / 2 + 3 * (yz**2 + xz**2 + xy**2))


def cut_by_body(corners, values, body, y):
    """Leaves cut by a plane across y, each body by itself.

    Local.  VTK makes one point of all that a cut has at one place: two bodies in contact would share the stress of one.

    Args:
        corners: (n, 8, 3) float64, corners of leaves [m].
        values: (n, 8) float64, stress there [Pa].
        body: (n,) int, body of each leaf.
        y: place of the plane [m].

    Returns:
        list of pyvista PolyData with point values "stress", one for each body that the plane cuts.
    """
    import pyvista

    sections = []
    for which in np.unique(body):
        ours = body == which
        cells = 8 * np.arange(ours.sum())[:, None] + [0, 1, 3, 2, 4, 5, 7, 6]
        grid = pyvista.UnstructuredGrid({pyvista.CellType.HEXAHEDRON: cells}, corners[ours].reshape(-1, 3))
        grid["stress"] = values[ours].ravel()
        sections.append(grid.slice(normal=(0, 1, 0), origin=(0, y, 0)))
    return sections


def _draw_cut(corners, values, body, y, path):
    import pyvista

    section = pyvista.merge(cut_by_body(corners, values, body, y), merge_points=False)
    plotter = pyvista.Plotter(off_screen=True, window_size=(1500, 1000))
    plotter.set_background("white")
    plotter.enable_parallel_projection()
    plotter.add_mesh(
        section,
        scalars="stress",
        cmap="viridis",
        clim=(0, np.percentile(section["stress"], 99)),
        lighting=False,
        scalar_bar_args={
            "title": "von Mises stress [Pa]; the highest 1 % are above the scale",
            "color": "black",
            "vertical": False,
            "n_labels": 2,
            "width": 0.5,
            "height": 0.12,
            "position_x": 0.25,
            "position_y": 0.01,
            "title_font_size": 22,
            "label_font_size": 20,
            "fmt": "%.2g",
        },
    )
    plotter.add_mesh(_outlines(corners, y), color="#202020", line_width=1, lighting=False)
    plotter.view_xz()
    x, z = np.ptp(corners[:, :, [0, 2]], axis=(0, 1))
    plotter.camera.parallel_scale = 0.6 * max(z, x / 1.5)
    lower = np.array([0, 0, 0.08 * plotter.camera.parallel_scale])  # room for the scale
    plotter.camera.focal_point, plotter.camera.position = (
        np.array(place) - lower for place in (plotter.camera.focal_point, plotter.camera.position)
    )
    plotter.screenshot(path)
    plotter.close()


def _outlines(corners, y):
    """The lines in which a plane across y cuts the faces of leaves."""
    import pyvista

    quads = corners[:, reference.FACE_CORNERS[:, [0, 1, 3, 2]]].reshape(-1, 4, 3)
    quads = quads[(quads[:, :, 1].min(axis=1) <= y) & (quads[:, :, 1].max(axis=1) >= y)]
    faces = np.hstack([np.full((len(quads), 1), 4), np.arange(4 * len(quads)).reshape(-1, 4)])
    return pyvista.PolyData(quads.reshape(-1, 3), faces=faces.ravel()).slice(normal=(0, 1, 0), origin=(0, y, 0))


def _writing(path, draw):
    """Draw, and say what is wrong if the picture cannot be written."""
    try:
        draw()
    except (OSError, ValueError) as error:
        raise OutputError(f"cannot draw {str(path)!r}: {error}; name another output folder") from error


def _visible_faces(forest, centre, reach):
    """Leaf faces near a point that lie on the boundary, or on the plane y = 0, of the half y >= 0.

    Returns (m, 4, 3) corners and (m,) leaves.
    """
    position = forest.mesh.evaluate(forest.cell, forest.corners[:, [0, 7]].swapaxes(1, 2) / SIDE)
    near = (np.abs(position.mean(axis=1) - centre) < 3 * reach).all(axis=1) & (
        position[:, :, 1].mean(axis=1) > centre[1]
    )
    corners = position[near][:, reference.FACE_CORNERS]
    in_plane = (np.abs(corners[..., 1] - centre[1]) < 1e-9 * reach).all(axis=2)
    exterior = np.argwhere(forest.mesh.face_neighbours == 1)
    leaf, face = forest.boundary_faces(exterior)
    outer = np.zeros((len(forest), 6), dtype=bool)
    outer[leaf, face] = True
    seen = in_plane | outer[near]
    return corners[seen], np.flatnonzero(near)[np.nonzero(seen)[0]]


def _draw_faces(faces, colours, legend, centre, reach, path):
    import pyvista

    plotter = pyvista.Plotter(off_screen=True, window_size=(1200, 840))
    plotter.set_background("white")
    plotter.enable_parallel_projection()
    for corners, colour in zip(faces, colours):
        if not len(corners):
            continue
        quads = np.arange(4 * len(corners)).reshape(-1, 4)[:, [0, 1, 3, 2]]
        cells = np.hstack([np.full((len(quads), 1), 4), quads])
        plotter.add_mesh(
            pyvista.PolyData(corners.reshape(-1, 3), faces=cells.ravel()),
            color=colour,
            show_edges=True,
            edge_color="#202020",
            line_width=1,
            ambient=0.65,
            diffuse=0.4,
        )
    if legend:
        size = (0.15, 0.04 * len(legend) + 0.02)
        plotter.add_legend(legend, bcolor="white", border=True, face="rectangle", size=size, loc="upper right")
    plotter.camera_position = [centre + reach * np.array([-2.2, -4.0, 1.2]), centre, (0, 0, 1)]
    plotter.camera.parallel_scale = 0.7 * reach
    plotter.screenshot(path)
    plotter.close()


def _matplotlib():
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    return plt


@contextmanager
def _display():
    """An X display for pyvista: the one that is there, or a virtual one for as long as it is needed."""
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
