"""Simple solids as `problem.shapes`: block, ring, cylinder and ball, whole or the parts that symmetry leaves.

Round ones have all nodes of their round sides on them, and the diameter planes as sides "x = 0", "y = 0", "z = 0".
Lengths are in the unit of the mesh.  All functions are local.
"""

import numpy as np

from fx_contact.parallel.errors import GeometryError, SceneError
from fx_contact.parallel.validation import check_count, check_number, check_vector, shown
from fx_contact.problem import hexahedron
from fx_contact.problem.root_mesh_checks import MAX_ORDER
from fx_contact.problem.shapes import Shape, join

#: Sides of a block, by local face.
BOTTOM, FRONT, LEFT, RIGHT, BACK, TOP = "bottom", "front", "left", "right", "back", "top"
_SIDES = (BOTTOM, FRONT, LEFT, RIGHT, BACK, TOP)

#: Corners of the inner block of a cylinder or ball on an axis, on a diagonal and on a space diagonal, over the radius.
_ON_AXIS, _ON_DIAGONAL, _ON_SPACE_DIAGONAL = 0.5, 0.55 / np.sqrt(2), 0.6 / np.sqrt(3)

#: Order of the cell maps where none is given, the highest.  Two cells along a quarter of an arc of order 3 have a
#: curvature 1.5 % off where contact begins, and small contact feels it; leaves take no higher order than they need.
ORDER = MAX_ORDER


def block(low, high, cells, order=ORDER):
    """A box along the axes.

    Args:
        low, high: its corners (3,).
        cells: their numbers along x, y, z.
        order: of the cell maps, 1 to 6.

    Returns:
        Shape with the sides "left" and "right" (x), "front" and "back" (y), "bottom" and "top" (z).

    Raises:
        SceneError: no three numbers.
        GeometryError: an order out of its range, or corners that leave no box.
    """
    for what, corner in (("the low corner of a block", low), ("the high corner of a block", high)):
        check_vector(what, corner)
    check_vector("the numbers of cells along x, y and z", cells)
    for count in cells:
        check_count("the number of cells along x, y or z", count)
    if isinstance(order, bool) or order not in range(1, MAX_ORDER + 1):
        raise GeometryError(f"the order of a shape must be 1 to {MAX_ORDER}, got {shown(order)}")
    if any(a >= b for a, b in zip(low, high)):
        raise GeometryError(f"a block from {tuple(low)} to {tuple(high)} has no volume: give the low corner first")
    counts = np.array(cells, dtype=np.int64)
    axes = [np.linspace(a, b, order * n + 1) for a, b, n in zip(low, high, counts)]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    strides = np.cumprod([1, *(order * counts[:2] + 1)])
    place = np.stack(np.unravel_index(np.arange(counts.prod()), counts[::-1])[::-1], axis=1)
    nodes = (order * place @ strides)[:, None] + hexahedron.grid_points(order) @ strides
    last = np.where(hexahedron.FACE_SIDE == 1, counts[hexahedron.FACE_AXIS] - 1, 0)
    outer = place[:, hexahedron.FACE_AXIS] == last
    sides = {name: np.argwhere(outer & (np.arange(6) == face)).astype(np.int32) for face, name in enumerate(_SIDES)}
    return Shape(np.stack([x, y, z], axis=-1).reshape(-1, 3), nodes, sides)


def ring(inner, outer, length, cells, order=ORDER, quarters=4):
    """A ring about the z axis, from z = 0.

    Args:
        inner, outer: radii.
        length: along z.
        cells: their numbers across, around a quarter, and along z.
        order: of the cell maps, 1 to 6.
        quarters: 1: x, y >= 0; 2: x >= 0; 4: the whole.

    Returns:
        Shape with the sides "inside", "outside", "bottom" and "top", and where they are cut "x = 0" and "y = 0".

    Raises:
        SceneError: what is no length or number of cells, or another number of quarters.
        GeometryError: an order out of its range, or an inner radius that is not the smaller one.
    """
    _check_lengths(inner_radius=inner, outer_radius=outer, length=length)
    if not inner < outer:
        raise GeometryError(f"a ring has a smaller radius inside, got {inner} inside and {outer} outside")

    def place(x):
        """From the unit block: across, around and along."""
        radius, angle = inner + x[0] * (outer - inner), np.pi / 2 * x[1]
        return radius * np.cos(angle), radius * np.sin(angle), length * x[2]

    names = {LEFT: "inside", RIGHT: "outside", FRONT: "y = 0", BACK: "x = 0", BOTTOM: BOTTOM, TOP: TOP}
    return _copies(_part(cells, order, place, names), "quarters", quarters, "yx")


def cylinder(radius, length, cells, order=ORDER, quarters=4):
    """A cylinder about the z axis, from z = 0, on an o-grid: a square block inside, and one towards each side.

    Args:
        radius, length: of the cylinder.
        cells: their numbers along the edges of the blocks across, half of the square's side, and along z.
        order: of the cell maps, 1 to 6.
        quarters: 1: x, y >= 0; 2: x >= 0; 4: the whole.

    Returns:
        Shape with the sides "outside", "bottom" and "top", and where it is cut "x = 0" and "y = 0".

    Raises:
        SceneError: what is no length or number of cells, or another number of quarters.
        GeometryError: an order out of its range.
    """
    _check_lengths(radius=radius, length=length)
    if np.shape(cells) != (2,):
        raise SceneError(f"a cylinder takes two numbers of cells, across and along, got {shown(cells)}")
    across, along = cells

    def square(x, y):
        """The inner block."""
        return [radius * a * (_ON_AXIS * (1 - b) + _ON_DIAGONAL * b) for a, b in ((x, y), (y, x))]

    def flank(x, y):
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


def ball(radius, cells, order=ORDER, octants=8):
    """A ball about the origin: an inner block, and one towards each side.

    Args:
        radius: of the ball.
        cells: their number along each edge of the blocks of an octant.
        order: of the cell maps, 1 to 6.
        octants: 1: x, y, z >= 0; 2: x, z >= 0; 4: z >= 0; 8: the whole.

    Returns:
        Shape with the side "outside", and where it is cut "x = 0", "y = 0" and "z = 0".

    Raises:
        SceneError: what is no length or number of cells, or another number of octants.
        GeometryError: an order out of its range.
    """
    _check_lengths(radius=radius)

    def cube(x):
        """The inner block: a coordinate shrinks with the two others."""
        return [
            radius
            * a
            * (_ON_AXIS * (1 - b) * (1 - c) + _ON_DIAGONAL * (b + c - 2 * b * c) + _ON_SPACE_DIAGONAL * b * c)
            for a, b, c in (np.roll(x, -axis, axis=0) for axis in range(3))
        ]

    def flank(x):
        """From the inner block to the sphere around the z axis, outwards along z."""
        inside = cube(np.stack([x[0], x[1], np.ones_like(x[0])]))
        direction = np.stack([np.tan(np.pi / 4 * x[0]), np.tan(np.pi / 4 * x[1]), np.ones_like(x[0])])
        direction *= radius / np.linalg.norm(direction, axis=0)
        return [(1 - x[2]) * a + x[2] * b for a, b in zip(inside, direction)]

    planes = ["x = 0", "y = 0", "z = 0"]
    parts = [_part((cells,) * 3, order, cube, dict(zip((LEFT, FRONT, BOTTOM), planes)))]
    for turn in range(3):
        names = {TOP: "outside", LEFT: planes[turn], FRONT: planes[(1 + turn) % 3]}
        parts.append(_part((cells,) * 3, order, lambda x, turn=turn: np.roll(flank(x), turn, axis=0), names))
    return _copies(join(*parts), "octants", octants, "yxz")


def _part(cells, order, place, names):
    """A unit block moved to its place, its sides called by other names, or left out: Shape."""
    unit = block((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), cells, order)
    return Shape(unit.points, unit.cells, {new: unit.sides[old] for old, new in names.items()}).placed(place)


def _copies(shape, what, count, axes):
    """A shape joined with its mirror images across one axis after the other until there are as many as wanted."""
    counts = [2**power for power in range(len(axes) + 1)]
    if isinstance(count, bool) or count not in counts:
        raise SceneError(f"the number of {what} must be one of {counts}, got {shown(count)}")
    for axis in axes[: counts.index(count)]:
        shape = join(shape, shape.mirrored(axis))
    return shape


def _check_lengths(**lengths):
    """Raises SceneError unless all are positive numbers."""
    for name, value in lengths.items():
        check_number(name.replace("_", " "), value, positive=True)
