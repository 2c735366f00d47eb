"""Leaves in three dimensions: around the contact or all of them, coloured by rank, level or part."""

import colorsys

import numpy as np
from mpi4py import MPI

from fx_contact.adaptive.step import check_step
from fx_contact.fem.leaf_mesh import leaf_positions
from fx_contact.parallel.validation import check_name, check_number
from fx_contact.plot.canvas import draw_on_first, import_pyvista, plotter_for
from fx_contact.problem import hexahedron

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

#: What leaves can be coloured by.
COLOURINGS = ("rank", "level")


def draw_mesh(step, path, zoom=3.0, colour="rank"):
    """The undeformed leaves around the contact, cut open along y = 0 and coloured.

    Collective on the step's communicator; rank 0 draws.  Only faces that can be seen are brought together.

    Args:
        step: Step with contact.
        path: of the PNG.
        zoom: half width of the picture, in contact radii.
        colour: "rank" or "level", of refinement.

    Returns:
        Path of the picture.

    Raises:
        SceneError: an unknown colouring, a zoom that is not positive, or a step without contact.
        OutputError: the picture cannot be written.
    """
    check_step(step, contact=True)
    check_number("the zoom of a picture", zoom, positive=True)
    centre = np.asarray(step.scene.contact_centre)
    return _draw_leaves(step.forest, centre, centre, zoom * contact_size(step), colour, path)


def contact_size(step):
    """Radius of the contact, or the size of its facets if that is larger or if nothing touches [m].

    Collective on the step's communicator.

    Args:
        step: Step with contact.
    """
    shown = step.solution.active if step.record.active_pairs else np.ones(len(step.pairs), dtype=bool)
    size = float(np.sqrt(step.pairs.area[shown].max(initial=0.0)))
    return max(step.record.contact_radius, step.forest.comm.allreduce(size, op=MPI.MAX))


def draw_partition(step, path, colour="rank"):
    """All undeformed leaves, cut open along y = 0 through the contact's centre and coloured.

    Collective on the step's communicator; rank 0 draws.  Only faces that can be seen are brought together.

    Args:
        step: Step.
        path: of the PNG.
        colour: "rank" or "level", of refinement.

    Returns:
        Path of the picture.

    Raises:
        SceneError: an unknown colouring, or no step.
        OutputError: the picture cannot be written.
    """
    check_step(step)
    low, high = step.scene.mesh.points.min(axis=0), step.scene.mesh.points.max(axis=0)
    cut = np.asarray(step.scene.contact_centre)
    reach = max(*(high - low), *np.abs(high - cut), *np.abs(low - cut))
    return _draw_leaves(step.forest, cut, (low + high) / 2, reach, colour, path)


def draw_parts(forest, part, centre, reach, path):
    """The leaves of a forest on one rank around a point, as `draw_mesh` shows them, coloured by part.

    Local.

    Args:
        forest: Forest, all of it on this rank.
        part: (n,) int, part of each leaf.
        centre: (3,) point [m].
        reach: half width of the picture [m].
        path: of the PNG.

    Returns:
        Path of the picture.

    Raises:
        OutputError: the picture cannot be written.
    """
    faces, leaf = _visible_faces(forest, np.asarray(centre), reach)
    shown, count = part[leaf], int(part.max()) + 1
    # Golden-section steps around the circle of hues, so that parts of near numbers differ.
    hues = np.arange(count) * 0.618034 % 1.0
    colours = [colorsys.hsv_to_rgb(h, 0.45 + 0.4 * (i % 2), 0.95 - 0.25 * (i // 2 % 2)) for i, h in enumerate(hues)]
    groups = [faces[shown == p] for p in range(count)]
    return draw_on_first(MPI.COMM_SELF, path, lambda path: _draw_faces(groups, colours, [], centre, reach, path))


def _draw_leaves(forest, cut, centre, reach, colour, path):
    """Draw the leaves near a point, cut open at its y, looking at a centre, coloured by one of `COLOURINGS`."""
    check_name("colouring", colour, COLOURINGS)
    comm = forest.comm
    faces, leaf = _visible_faces(forest, cut, reach)
    group = np.full(len(leaf), comm.rank) if colour == "rank" else forest.level[leaf].astype(int)
    parts = comm.gather((faces, group), root=0)

    def draw(path):
        """The picture, on the first rank."""
        faces, group = (np.concatenate(column) for column in zip(*parts))
        numbers = range(comm.size) if colour == "rank" else range(group.min(), group.max() + 1)
        colours = _rank_colours(comm.size) if colour == "rank" else _level_colours(numbers)
        legend = [[f"{colour} {number}", shade] for number, shade in zip(numbers, colours)]
        _draw_faces([faces[group == number] for number in numbers], colours, legend, centre, reach, path)

    return draw_on_first(comm, path, draw)


def _rank_colours(count):
    return [RANK_COLOURS[rank % len(RANK_COLOURS)] for rank in range(count)]


def _level_colours(levels):
    """From light to dark, a level the same in all pictures."""
    from matplotlib import colormaps

    return [colormaps["viridis_r"](0.95 - 0.85 * 0.75**level)[:3] for level in levels]


def _visible_faces(forest, centre, reach):
    """Leaf faces near a point, of the half beyond its y, on the boundary or the cut: (m, 4, 3) corners, (m,) leaves."""
    position = leaf_positions(forest, slice(None), 1)
    near = (np.abs(position.mean(axis=1) - centre) < 3 * reach).all(axis=1) & (
        position[:, :, 1].mean(axis=1) > centre[1]
    )
    corners = position[near][:, hexahedron.FACE_CORNERS]
    in_plane = (np.abs(corners[..., 1] - centre[1]) < 1e-9 * reach).all(axis=2)
    exterior = np.argwhere(forest.mesh.face_neighbours == 1)
    leaf, face = forest.boundary_faces(exterior)
    outer = np.zeros((len(forest), 6), dtype=bool)
    outer[leaf, face] = True
    seen = in_plane | outer[near]
    return corners[seen], np.flatnonzero(near)[np.nonzero(seen)[0]]


def _draw_faces(faces, colours, legend, centre, reach, path):
    pyvista = import_pyvista()

    with plotter_for(path) as plotter:
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
        if len(legend) > 1:
            size = (0.16, 0.045 * len(legend))
            plotter.add_legend(legend, bcolor="white", border=True, face="rectangle", size=size, loc="upper right")
        plotter.camera_position = [centre + reach * np.array([-2.2, -4.0, 1.2]), centre, (0, 0, 1)]
        plotter.camera.parallel_scale = 0.7 * reach
