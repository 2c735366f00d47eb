"""Simple solids as shapes (`geometry.shapes`): block, ring, cylinder and ball, whole or cut by planes of symmetry.

All nodes of round sides lie on the exact surface; the planes of the cut are the sides "x = 0", "y = 0", "z = 0".
Lengths are in the unit of the mesh.  All functions are local.
"""

from collections.abc import Sequence
from dataclasses import replace
from numbers import Integral

import numpy as np

from fx_contact.geometry import hexahedron
from fx_contact.geometry.root_mesh_checks import MAX_ORDER, MOST_CELLS
from fx_contact.geometry.shapes import Placement, Shape, join
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import GeometryError, SceneError
from fx_contact.parallel.validation import check_count, check_number, check_vector, shown

#: Sides of a block, by local face.
BOTTOM, FRONT, LEFT, RIGHT, BACK, TOP = "bottom", "front", "left", "right", "back", "top"
_SIDES = (BOTTOM, FRONT, LEFT, RIGHT, BACK, TOP)

#: Distances of the inner block's corners on an axis, a diagonal and a space diagonal over the radius.
_ON_AXIS, _ON_DIAGONAL, _ON_SPACE_DIAGONAL = 0.5, 0.55 / np.sqrt(2), 0.6 / np.sqrt(3)

#: Default order of the cell maps; leaves use no higher order than they need.  Two cells of order 3 along an eighth of
#: a circle have an error of 1.5 % in the curvature, which matters for small contact areas.
ORDER = MAX_ORDER


def block(low: Sequence[float], high: Sequence[float], cells: Sequence[int], order: int = ORDER) -> Shape:
    """A box along the axes with two opposite corners and numbers of cells along x, y, z.

    Its sides are "left" and "right" (x), "front" and "back" (y), "bottom" and "top" (z).
    Raises SceneError unless corners and cells have three numbers, GeometryError for an invalid order or no volume.
    """
    for what, corner in (("the low corner of a block", low), ("the high corner of a block", high)):
        check_vector(what, corner)
    check_vector("the numbers of cells", cells)  # of all solids, whatever their directions
    for count in cells:
        check_count("each number of cells", count)
    if isinstance(order, bool) or not isinstance(order, Integral) or order not in range(1, MAX_ORDER + 1):
        raise GeometryError(f"the order of a shape must be 1 to {MAX_ORDER}, got {shown(order)}")
    if any(a >= b for a, b in zip(low, high)):
        raise GeometryError(f"a block from {tuple(low)} to {tuple(high)} has no volume: give the low corner first")
    counts = np.array(cells, dtype=np.int64)
    if counts.prod() > MOST_CELLS:
        raise GeometryError(
            f"{counts.prod():,} cells are more than the {MOST_CELLS:,} of a root mesh: refinement makes the small ones"
        )
    axes = [np.linspace(a, b, order * n + 1) for a, b, n in zip(low, high, counts)]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    strides = np.cumprod([1, *(order * counts[:2] + 1)])
    place = np.stack(np.unravel_index(np.arange(counts.prod()), counts[::-1])[::-1], axis=1)
    nodes = (order * place @ strides)[:, None] + hexahedron.grid_points(order) @ strides
    last = np.where(hexahedron.FACE_SIDE == 1, counts[hexahedron.FACE_AXIS] - 1, 0)
    outer = place[:, hexahedron.FACE_AXIS] == last
    sides = {name: np.argwhere(outer & (np.arange(6) == face)).astype(np.int32) for face, name in enumerate(_SIDES)}
    return Shape(np.stack([x, y, z], axis=-1).reshape(-1, 3), nodes, sides)


def ring(
    inner: float, outer: float, length: float, cells: Sequence[int], order: int = ORDER, quarters: int = 4
) -> Shape:
    """A ring about the z axis from z = 0, with the sides "inside", "outside", "bottom", "top", "x = 0" and "y = 0".

    Args:
        inner, outer: radii.
        cells: numbers in the radial direction, around a quarter, and along z.
        order: of the cell maps, 1 to 6.
        quarters: 1: x, y >= 0; 2: x >= 0; 4: the whole.

    Raises:
        SceneError, GeometryError: an argument out of range.
    """
    _check_lengths(inner_radius=inner, outer_radius=outer, length=length)
    if not inner < outer:
        raise GeometryError(f"a ring has a smaller radius inside, got {inner} inside and {outer} outside")

    def place(x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        radius, angle = inner + x[0] * (outer - inner), np.pi / 2 * x[1]
        return radius * np.cos(angle), radius * np.sin(angle), length * x[2]

    names = {LEFT: "inside", RIGHT: "outside", FRONT: "y = 0", BACK: "x = 0", BOTTOM: BOTTOM, TOP: TOP}
    return _copies(_part(cells, order, place, names), "quarters", quarters, "yx")


def cylinder(radius: float, length: float, cells: Sequence[int], order: int = ORDER, quarters: int = 4) -> Shape:
    """A cylinder about the z axis from z = 0, with the sides "outside", "bottom", "top", "x = 0" and "y = 0".

    Its mesh is an o-grid: a square inner block, and one block towards each side.  Other arguments are as in `ring`.

    Args:
        cells: numbers along the edges of the blocks in the cross section, half of the square's side, and along z.

    Raises:
        SceneError, GeometryError: an argument out of range.
    """
    _check_lengths(radius=radius, length=length)
    if np.shape(cells) != (2,):
        raise SceneError(f"a cylinder takes two numbers of cells, across and along, got {shown(cells)}")
    across, along = cells

    def square(x: FloatArray, y: FloatArray) -> list[FloatArray]:
        return [radius * a * (_ON_AXIS * (1 - b) + _ON_DIAGONAL * b) for a, b in ((x, y), (y, x))]

    def flank(x: FloatArray, y: FloatArray) -> list[FloatArray]:
        """From the inner block to the arc from angle 0 to 45 degrees: outwards along x, around along y."""
        inside, angle = square(np.ones_like(y), y), np.pi / 4 * y
        return [(1 - x) * a + x * radius * b for a, b in zip(inside, (np.cos(angle), np.sin(angle)))]

    parts = (
        (lambda x: (*square(x[0], x[1]), length * x[2]), {LEFT: "x = 0", FRONT: "y = 0"}),
        (lambda x: (*flank(x[0], x[1]), length * x[2]), {RIGHT: "outside", FRONT: "y = 0"}),
        (lambda x: (*flank(x[1], x[0])[::-1], length * x[2]), {BACK: "outside", LEFT: "x = 0"}),
    )
    counts, ends = (across, across, along), {BOTTOM: BOTTOM, TOP: TOP}
    return _copies(
        join(*(_part(counts, order, place, names | ends) for place, names in parts)), "quarters", quarters, "yx"
    )


def ball(radius: float, cells: int, order: int = ORDER, octants: int = 8) -> Shape:
    """A ball about the origin, with the sides "outside", "x = 0", "y = 0" and "z = 0".

    Its mesh is an inner block, and one block towards each side, with `cells` along each edge in an octant.

    Args:
        order: of the cell maps, 1 to 6.
        octants: 1: x, y, z >= 0; 2: x, z >= 0; 4: z >= 0; 8: the whole.

    Raises:
        SceneError, GeometryError: an argument out of range.
    """
    _check_lengths(radius=radius)

    def cube(x: FloatArray) -> FloatArray:
        """The inner block: a coordinate shrinks with the two others."""
        b, c = np.roll(x, -1, axis=0), np.roll(x, -2, axis=0)
        shrunk = _ON_AXIS * (1 - b) * (1 - c) + _ON_DIAGONAL * (b + c - 2 * b * c) + _ON_SPACE_DIAGONAL * b * c
        return radius * x * shrunk

    def flank(x: FloatArray) -> FloatArray:
        """From the inner block to the sphere around the z axis, outwards along z."""
        inside = cube(np.stack([x[0], x[1], np.ones_like(x[0])]))
        direction = np.stack([np.tan(np.pi / 4 * x[0]), np.tan(np.pi / 4 * x[1]), np.ones_like(x[0])])
        direction *= radius / np.linalg.norm(direction, axis=0)
        return (1 - x[2]) * inside + x[2] * direction

    planes = ["x = 0", "y = 0", "z = 0"]
    parts = [_part((cells,) * 3, order, cube, dict(zip((LEFT, FRONT, BOTTOM), planes)))]
    for turn in range(3):
        names = {TOP: "outside", LEFT: planes[turn], FRONT: planes[(1 + turn) % 3]}
        cap = _part((cells,) * 3, order, flank, names)
        parts.append(replace(cap, points=np.roll(cap.points, turn, axis=1)))
    return _copies(join(*parts), "octants", octants, "yxz")


def _part(cells: Sequence[int], order: int, place: Placement, names: dict[str, str]) -> Shape:
    """A unit block moved by `place`, with its sides renamed (old -> new) or left out."""
    unit = block((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), cells, order)
    return Shape(unit.points, unit.cells, {new: unit.sides[old] for old, new in names.items()}).placed(place)


def _copies(shape: Shape, what: str, count: int, axes: str) -> Shape:
    """A shape joined with its mirror images across one axis after the other, until there are `count` copies."""
    counts = [2**power for power in range(len(axes) + 1)]
    if isinstance(count, bool) or count not in counts:
        raise SceneError(f"the number of {what} must be one of {counts}, got {shown(count)}")
    for axis in axes[: counts.index(count)]:
        shape = join(shape, shape.mirrored(axis))
    return shape


def _check_lengths(**lengths: float) -> None:
    for name, value in lengths.items():
        check_number(name.replace("_", " "), value, positive=True)
