"""Blocks one on another between plates: as many bodies as wanted, in uniform compression."""

import math

from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_count
from fx_contact.problem.boundary_conditions import Dirichlet, SymmetryPlane, Traction
from fx_contact.problem.contact import ContactPair
from fx_contact.problem.materials import Material
from fx_contact.problem.scene import Scene
from fx_contact.problem.shapes import root_mesh_from_shapes
from fx_contact.problem.solids import block
from fx_contact.scenes.arguments import MOST_CELLS, check_arguments


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
        gap: initial distance between neighbours, negative where they penetrate each other [m].
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
    bodies, pairs = {}, []
    for level, name in enumerate(names):
        unit = block((0.0, 0.0, level), (0.5, 0.5, level + 1.0), cells, order)
        bodies[name] = unit.placed(lambda x, move=level * gap: (side * x[0], side * x[1], height * x[2] + move))
    surfaces = {"bottom": f"{names[0]} bottom", "top": f"{names[-1]} top"}
    surfaces |= {plane: [f"{name} {end}" for name in names] for plane, end in (("x = 0", "left"), ("y = 0", "front"))}
    for lower, upper in zip(names, names[1:]):
        surfaces |= {f"on {lower}": f"{lower} top", f"under {upper}": f"{upper} bottom"}
        pairs.append(ContactPair(f"on {lower}", f"under {upper}", direction=(0.0, 0.0, 1.0)))
    conditions = [Dirichlet("bottom", z=0.0), SymmetryPlane("x = 0"), SymmetryPlane("y = 0")]
    if pressure is None:
        conditions.append(Dirichlet("top", z=-float(displacement)))
    return Scene(
        name="stack",
        mesh=root_mesh_from_shapes(bodies, surfaces),
        materials=dict(zip(names, materials)),
        dirichlet=tuple(conditions),
        contact=tuple(pairs),
        tractions=() if pressure is None else (Traction("top", (0.0, 0.0, -float(pressure))),),
        symmetry=4,
    )


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
