"""Leaves in three dimensions, around the contact or all of them, coloured by rank, level or part."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from mpi4py import MPI

from fx_contact.adaptive.step import Step, check_step
from fx_contact.forest.forest import Forest
from fx_contact.items.units import Units
from fx_contact.parallel.arrays import FloatArray, IntArray
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.validation import check_name, check_number
from fx_contact.plot.canvas import add_length, draw_on_first, leave_strip, on_first, picture_size, plotter_for
from fx_contact.plot.faces import EYE, face_points, surface_and_edges, visible_faces
from fx_contact.plot.obstacles import Shown, add_obstacles, placed_obstacles

if TYPE_CHECKING:
    from pyvista import Plotter

Colour: TypeAlias = tuple[float, float, float]

#: Colours that the colour-blind tell apart (Okabe and Ito, without black).
_PALETTE = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#F0E442")
#: Mixtures in successive rounds through the palette: grey value, 1 is white and 0 black, and its share.
_MIXED = ((1.0, 0.0), (1.0, 0.5), (0.0, 0.4))
#: Maximum number of groups in a legend.
_LISTED = 16
#: Share of the width that the bodies leave to it: ten characters.
_STRIP = 0.11


def _number_colour(number: int) -> Colour:
    """Colours of the palette in turn, then lighter and darker ones."""
    from matplotlib.colors import to_rgb

    grey, share = _MIXED[number // len(_PALETTE) % len(_MIXED)]
    red, green, blue = ((1 - share) * part + share * grey for part in to_rgb(_PALETTE[number % len(_PALETTE)]))
    return red, green, blue


def _level_colour(level: int) -> Colour:
    """Colours from light to dark; a level has the same one in all pictures."""
    from matplotlib import colormaps

    red, green, blue, _ = colormaps["viridis_r"](0.95 - 0.85 * 0.75**level)
    return red, green, blue


#: Colourings of leaves by name.
_COLOURS: dict[str, Callable[[int], Colour]] = {"rank": _number_colour, "level": _level_colour}


@collective("step.forest.comm")
def draw_mesh(
    step: Step,
    path: str | Path | None = None,
    zoom: float = 3.0,
    colour: str = "rank",
    *,
    plotter: "Plotter | None" = None,
) -> "Path | Plotter | None":
    """Undeformed leaves around the contact, coloured, without those before the plane across y through its centre.

    Rigid obstacles touch them.

    Collective on the step's communicator; rank 0 draws and receives visible faces only.

    Args:
        path: of the PNG, if no plotter is given.
        zoom: half width of the picture, in contact radii.
        colour: "rank" or "level", of refinement.
        plotter: to draw on, the one of rank 0; it or the path is returned.

    Raises:
        SceneError: an unknown colouring, a zoom that is not positive, or a step without contact.
        OutputError: the picture cannot be written.
    """
    check_step(step, contact=True)
    check_number("the zoom of a picture", zoom, positive=True)
    centre = np.asarray(step.record.contact_centre)
    group = _groups(step.forest, colour)
    reach, obstacles = zoom * contact_size(step), placed_obstacles(step, 0.0)
    return _draw_groups(step.forest, group, colour, centre, centre, reach, path, plotter, obstacles, step.scene.units)


def contact_size(step: Step) -> float:
    """Contact radius [m]; of a contact that is not round, the largest distance of a closed pair from its centre.

    Collective on the step's communicator.  At least the size of the facets in contact.
    """
    pairs, radius = step.rows, step.record.contact_radius
    assert pairs is not None, "checked by check_step"
    shown = step.solution.active if step.record.active_pairs else np.ones(len(pairs), dtype=bool)
    size = float(np.sqrt(pairs.area[shown].max(initial=0.0)))
    if radius is None:
        arm = np.linalg.norm(pairs.position[shown] - np.asarray(step.record.contact_centre), axis=1)
        size = max(size, float(arm.max(initial=0.0)))
    return max(radius or 0.0, step.forest.comm.allreduce(size, op=MPI.MAX))


@collective("step.forest.comm")
def draw_partition(
    step: Step, path: str | Path | None = None, colour: str = "rank", *, plotter: "Plotter | None" = None
) -> "Path | Plotter | None":
    """All undeformed leaves, coloured, without those before the plane across y through the centre of the contact.

    Collective on the step's communicator; rank 0 draws and receives visible faces only.  Arguments as in `draw_mesh`.
    Raises SceneError for an unknown colouring or no step, OutputError if the picture cannot be written.
    """
    check_step(step)
    low, high = step.scene.mesh.points.min(axis=0), step.scene.mesh.points.max(axis=0)
    cut = np.asarray(step.record.contact_centre)
    reach = max(*(high - low), *np.abs(high - cut), *np.abs(low - cut))
    group = _groups(step.forest, colour)
    return _draw_groups(step.forest, group, colour, cut, (low + high) / 2, reach, path, plotter, (), step.scene.units)


def draw_parts(
    forest: Forest, part: IntArray, centre: FloatArray, reach: float, path: str | Path
) -> "Path | Plotter | None":
    """Leaves of a forest on one rank around a point, as in `draw_mesh`, coloured by part.

    Local.  Raises OutputError if the picture cannot be written.

    Args:
        part: (n,), part of each leaf.
        centre: (3,) point [m].
        reach: half width of the picture [m].
    """
    return _draw_groups(forest, part, "", np.asarray(centre), np.asarray(centre), reach, path, None)


def _groups(forest: Forest, colour: str) -> IntArray:
    check_name("colouring", colour, _COLOURS)
    return forest.level.astype(int) if colour == "level" else np.full(len(forest), forest.comm.rank)


def _draw_groups(
    forest: Forest,
    group: IntArray,
    word: str,
    cut: FloatArray,
    centre: FloatArray,
    reach: float,
    path: str | Path | None,
    given: "Plotter | None",
    obstacles: Sequence[Shown] = (),
    units: Units = None,
) -> "Path | Plotter | None":
    """Leaves beyond the y of a point, about a centre, in the colours of their groups; a legend if there is a word."""
    leaf, face = visible_faces(forest, cut, reach)
    shown = on_first(forest.comm, face_points(forest, leaf, face), group[leaf])
    colour = _COLOURS.get(word, _number_colour)

    def draw(plotter: "Plotter") -> None:
        """Add all that is shown, on rank 0."""
        faces, group = shown
        numbers = np.unique(group).tolist()
        for number in numbers:
            surface, edges = surface_and_edges(faces[group == number])
            plotter.add_mesh(surface, color=colour(number), ambient=0.65, diffuse=0.4)
            nearer = edges.translate(1e-3 * reach * EYE)  # before the surface
            plotter.add_mesh(nearer, color="#202020", line_width=2, lighting=False)
        if obstacles:
            near = faces.reshape(-1, 3)
            add_obstacles(plotter, obstacles, near[np.abs(near - centre).max(axis=1) <= 2 * reach])
        plotter.enable_parallel_projection()
        plotter.camera_position = [centre + reach * EYE, centre, (0, 0, 1)]
        plotter.camera.parallel_scale = 0.7 * reach
        if word and 1 < len(numbers) <= _LISTED:
            leave_strip(plotter, _STRIP)
            _add_legend(plotter, {f"{word} {number}": colour(number) for number in numbers})
        add_length(plotter, units)

    return draw_on_first(forest.comm, path, draw, plotter_for, given)


def _add_legend(plotter: "Plotter", colours: dict[str, Colour]) -> None:
    """Names on their colours at the right, in black or white; pyvista's legend writes light colours on white."""
    width, height = picture_size(plotter)
    line = max(26, height / 28)
    for row, (name, colour) in enumerate(colours.items()):
        light = np.dot(colour, (0.299, 0.587, 0.114)) > 0.5
        place = (width - line / 2, height - line * (row + 1.5))
        label = plotter.add_text(
            f" {name} ", position=place, font_size=int(line / 3), color="black" if light else "white"
        )
        label.prop.justification_horizontal = "right"
        label.prop.background_color, label.prop.background_opacity = colour, 1.0
