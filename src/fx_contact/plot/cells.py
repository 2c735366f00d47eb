"""Leaves in three dimensions: around the contact or all of them, coloured by rank, level or part."""

import numpy as np
from mpi4py import MPI

from fx_contact.adaptive.step import check_step
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.validation import check_name, check_number
from fx_contact.plot.canvas import add_length, draw_on_first, picture_size, plotter_for
from fx_contact.plot.faces import EYE, face_points, surface_and_edges, visible_faces

#: Colours that the colour-blind tell apart (Okabe and Ito, without black).
_PALETTE = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#F0E442")
#: Of a further round through them: how far they are mixed with white, or with black.
_MIXED = ((1.0, 0.0), (1.0, 0.5), (0.0, 0.4))
#: Most groups that a legend lists.
_LISTED = 16


def _number_colour(number):
    """Colours of the palette in turn, then lighter and darker ones."""
    from matplotlib.colors import to_rgb

    towards, share = _MIXED[number // len(_PALETTE) % len(_MIXED)]
    return tuple((1 - share) * part + share * towards for part in to_rgb(_PALETTE[number % len(_PALETTE)]))


def _level_colour(level):
    """From light to dark, a level the same in all pictures."""
    from matplotlib import colormaps

    return colormaps["viridis_r"](0.95 - 0.85 * 0.75**level)[:3]


#: What leaves can be coloured by.
_COLOURS = {"rank": _number_colour, "level": _level_colour}


@collective("step.forest.comm")
def draw_mesh(step, path=None, zoom=3.0, colour="rank", *, plotter=None):
    """The undeformed leaves around the contact, cut open along y = 0 and coloured.

    Collective on the step's communicator; rank 0 draws.  Only faces that can be seen are brought together.

    Args:
        step: Step with contact.
        path: of the PNG, if there is no plotter.
        zoom: half width of the picture, in contact radii.
        colour: "rank" or "level", of refinement.
        plotter: pyvista Plotter to draw on, that of rank 0; None: a file.

    Returns:
        Path of the picture, or the plotter.

    Raises:
        SceneError: an unknown colouring, a zoom that is not positive, or a step without contact.
        OutputError: the picture cannot be written.
    """
    check_step(step, contact=True)
    check_number("the zoom of a picture", zoom, positive=True)
    centre = np.asarray(step.record.contact_centre)
    return _draw_leaves(step.forest, colour, centre, centre, zoom * contact_size(step), path, plotter)


def contact_size(step):
    """Radius of the contact, of another than round contact its reach; at least the size of its facets [m].

    Collective on the step's communicator.

    Args:
        step: Step with contact.
    """
    shown = step.solution.active if step.record.active_pairs else np.ones(len(step.pairs), dtype=bool)
    size, radius = float(np.sqrt(step.pairs.area[shown].max(initial=0.0))), step.record.contact_radius
    if radius is None:
        arm = np.linalg.norm(step.pairs.position[shown] - step.record.contact_centre, axis=1)
        size = max(size, float(arm.max(initial=0.0)))
    return max(radius or 0.0, step.forest.comm.allreduce(size, op=MPI.MAX))


@collective("step.forest.comm")
def draw_partition(step, path=None, colour="rank", *, plotter=None):
    """All undeformed leaves, cut open along y = 0 through the contact's centre and coloured.

    Collective on the step's communicator; rank 0 draws.  Only faces that can be seen are brought together.

    Args:
        step: Step.
        path: of the PNG, if there is no plotter.
        colour: "rank" or "level", of refinement.
        plotter: pyvista Plotter to draw on, that of rank 0; None: a file.

    Returns:
        Path of the picture, or the plotter.

    Raises:
        SceneError: an unknown colouring, or no step.
        OutputError: the picture cannot be written.
    """
    check_step(step)
    low, high = step.scene.mesh.points.min(axis=0), step.scene.mesh.points.max(axis=0)
    cut = np.asarray(step.record.contact_centre)
    reach = max(*(high - low), *np.abs(high - cut), *np.abs(low - cut))
    return _draw_leaves(step.forest, colour, cut, (low + high) / 2, reach, path, plotter)


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
    cut = np.asarray(centre)
    return _draw_groups(forest, part, path, colour=_number_colour, word="", cut=cut, centre=cut, reach=reach)


def _draw_leaves(forest, colour, cut, centre, reach, path, plotter):
    """Draw the leaves near a point, cut open at its y, looking at a centre, coloured by rank or level."""
    check_name("colouring", colour, _COLOURS)
    group = forest.level.astype(int) if colour == "level" else np.full(len(forest), forest.comm.rank)
    look = {"cut": cut, "centre": centre, "reach": reach, "given": plotter}
    return _draw_groups(forest, group, path, colour=_COLOURS[colour], word=colour, **look)


def _draw_groups(forest, group, path, *, colour, word, cut, centre, reach, given=None):
    """Draw groups of leaves, each in the colour of its number; with a word before the number in the legend."""
    leaf, face = visible_faces(forest, cut, reach)
    parts = forest.comm.gather((face_points(forest, leaf, face), group[leaf]), root=0)

    def draw(plotter):
        """The picture, on the first rank."""
        faces, group = (np.concatenate(column) for column in zip(*parts))
        numbers = np.unique(group).tolist()
        for number in numbers:
            surface, edges = surface_and_edges(faces[group == number])
            plotter.add_mesh(surface, color=colour(number), ambient=0.65, diffuse=0.4)
            nearer = edges.translate(1e-3 * reach * EYE)  # lest they lie in the surface
            plotter.add_mesh(nearer, color="#202020", line_width=2, lighting=False)
        if word and 1 < len(numbers) <= _LISTED:
            _list_groups(plotter, {f"{word} {number}": colour(number) for number in numbers})
        plotter.enable_parallel_projection()
        plotter.camera_position = [centre + reach * EYE, centre, (0, 0, 1)]
        plotter.camera.parallel_scale = 0.7 * reach
        add_length(plotter)

    return draw_on_first(forest.comm, path, draw, plotter_for, given)


def _list_groups(plotter, colours):
    """Names on their colours, below each other at the right; the ink is black or white, whichever is read."""
    width, height = picture_size(plotter)
    line = max(26, height / 28)
    for row, (name, colour) in enumerate(colours.items()):
        light = np.dot(colour, (0.299, 0.587, 0.114)) > 0.5
        place = (width - line / 2, height - line * (row + 1.5))
        label = plotter.add_text(f" {name} ", place, font_size=int(line / 3), color="black" if light else "white")
        label.prop.justification_horizontal = "right"
        label.prop.background_color, label.prop.background_opacity = colour, 1.0
