"""Blocks one on another between plates: as many bodies as wanted, in uniform compression."""

import math

from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_count
from fx_contact.problem.boundary_conditions import Dirichlet, SymmetryPlane, Traction
from fx_contact.problem.materials import Material
from fx_contact.problem.scene import ContactPair, Scene
from fx_contact.scenes.arguments import MOST_CELLS, check_arguments
from fx_contact.scenes.boxes import DOWN, FRONT, LEFT, UP, Boxes


def stack(
    materials=(Material(young=1.0, poisson=0.3),) * 3,
    displacement=0.01,
    pressure=None,
    side=1.0,
    height=1.0,
    gap=0.0,
    order=1,
    cells=(2, 2, 2),
):
    """Blocks of one section between frictionless plates; the upper plate comes down, or a pressure acts on the top.

    Local.  A quarter is modelled.  Between plates the pressure is p = (displacement - sum of gaps) / sum of
    (height / E), everywhere the same: what a contact method must reproduce whatever the materials.  Under a pressure
    every block but the lowest is held vertically by contact alone.

    Args:
        materials: of the blocks, from below; two at least.
        displacement: of the top, downwards [m]; without meaning where a pressure is given.
        pressure: on the top [Pa]; None: the displacement is prescribed.
        side: width of the whole blocks [m].
        height: of each block [m].
        gap: initial distance between neighbours, negative where they overlap [m].
        order: of the root mesh, 1 to 6; the geometry is affine.
        cells: root cells of a quarter of a block along x, y, z.

    Returns:
        Scene; its bodies are "block 0", "block 1", ..., its contact pairs from below.

    Raises:
        SceneError, GeometryError: an argument outside its range.
    """
    if len(materials) < 2:
        raise SceneError(f"a stack needs two blocks at least, got {len(materials)}")
    numbers = {"displacement": displacement, "gap": gap, "pressure": pressure or 0.0}
    check_arguments(order, 1, {"side": side, "height": height}, numbers)
    for count in cells:
        check_count("the number of root cells along x, y or z", count)
    if (total := len(materials) * math.prod(cells)) > MOST_CELLS**3:
        raise SceneError(f"{total:,} root cells are too many: refinement makes the leaves, not the root mesh")
    names = [f"block {number}" for number in range(len(materials))]
    boxes, surfaces, pairs = _unit_blocks(names, order, cells)

    def place(body, points):
        """From unit boxes to blocks of the size that is asked for, with the gaps between them."""
        return points * [side, side, height] + [0, 0, names.index(body) * gap]

    conditions = [Dirichlet("bottom", z=0.0), SymmetryPlane("x = 0"), SymmetryPlane("y = 0")]
    if pressure is None:
        conditions.append(Dirichlet("top", z=-float(displacement)))
    return Scene(
        name="stack",
        mesh=boxes.mesh(surfaces, place=place),
        materials=dict(zip(names, materials)),
        dirichlet=tuple(conditions),
        contact=tuple(pairs),
        tractions=() if pressure is None else (Traction("top", (0.0, 0.0, -float(pressure))),),
        symmetry=4,
    )


def _unit_blocks(names, order, cells):
    """Boxes 0.5 x 0.5 x 1 one on another, their surfaces, and the contact pairs from below."""
    boxes = Boxes(order)
    for level, name in enumerate(names):
        boxes.add(name, (0.0, 0.0, level), (0.5, 0.5, level + 1.0), cells)
    surfaces = {
        "bottom": boxes.facets(DOWN, 0.0, names[0]),
        "top": boxes.facets(UP, len(names), names[-1]),
        "x = 0": boxes.facets(LEFT, 0.0),
        "y = 0": boxes.facets(FRONT, 0.0),
    }
    pairs = []
    for level, (lower, upper) in enumerate(zip(names, names[1:]), start=1):
        surfaces[f"on {lower}"] = boxes.facets(UP, level, lower)
        surfaces[f"under {upper}"] = boxes.facets(DOWN, level, upper)
        pairs.append(ContactPair(f"on {lower}", f"under {upper}", direction=(0.0, 0.0, 1.0)))
    return boxes, surfaces, pairs


def patch(
    lower=Material(young=1.0, poisson=0.3),
    upper=Material(young=3.0, poisson=0.2),
    displacement=0.01,
    order=1,
    cells=(2, 2, 4),
):
    """The patch test of contact: two columns of different materials, whose pressure p = u / (h/E1 + h/E2) is uniform.

    Local.

    Args:
        lower, upper: materials.
        displacement: of the top, downwards [m].
        order, cells: as in `stack`.

    Returns:
        Scene, a `stack` of two blocks of side and height 1.
    """
    return stack((lower, upper), displacement, order=order, cells=cells)
