"""Stacks of blocks between plates in uniform compression, of any number of bodies."""

import math
from collections.abc import Sequence

from fx_contact.geometry.shapes import root_mesh_from_shapes
from fx_contact.geometry.solids import block
from fx_contact.items.boundary_conditions import Dirichlet, SymmetryPlane, Traction
from fx_contact.items.contact import ContactPair
from fx_contact.items.materials import Material
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_count
from fx_contact.scene.scene import Scene
from fx_contact.scenes.arguments import MOST_CELLS, check_arguments


def stack(
    materials: Sequence[Material] = (Material(young=1.0, poisson=0.3),) * 3,
    displacement: float = 0.01,
    pressure: float | None = None,
    side: float = 1.0,
    height: float = 1.0,
    gap: float = 0.0,
    order: int = 1,
    cells: Sequence[int] = (2, 2, 2),
) -> Scene:
    """Blocks of one cross section between frictionless plates, compressed by the upper plate or by a pressure.

    Local.  A quarter is modelled.  Between plates the pressure is uniform, p = (displacement - sum of gaps) / sum of
    (height / E), and a contact method must reproduce it for any materials.  Under a pressure only contact supports the
    blocks above the lowest one vertically.  Raises SceneError or GeometryError for an argument out of range.

    Args:
        materials: of at least two blocks, from below; the bodies are "block 0", "block 1", ...
        displacement: of the top, downwards [m]; unused with a pressure.
        pressure: on the top [Pa]; None: the displacement is prescribed.
        side: width of the whole blocks [m].
        height: of each block [m].
        gap: initial distance between neighbours [m], negative for a penetration.
        order: of the root mesh, 1 to 6; the geometry is affine.
        cells: root cells of a quarter of a block along x, y, z.
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
        bodies[name] = unit.placed(lambda x: (side * x[0], side * x[1], height * x[2])).shifted(z=level * gap)
    surfaces: dict[str, str | list[str]] = {"bottom": f"{names[0]} bottom", "top": f"{names[-1]} top"}
    surfaces |= {plane: [f"{name} {end}" for name in names] for plane, end in (("x = 0", "left"), ("y = 0", "front"))}
    for lower, upper in zip(names, names[1:]):
        surfaces |= {f"on {lower}": f"{lower} top", f"under {upper}": f"{upper} bottom"}
        pairs.append(ContactPair(f"on {lower}", f"under {upper}", direction=(0.0, 0.0, 1.0)))
    planes = SymmetryPlane("x = 0"), SymmetryPlane("y = 0")
    top = (Dirichlet("top", z=-float(displacement)),) if pressure is None else ()
    return Scene(
        name="stack",
        mesh=root_mesh_from_shapes(bodies, surfaces),
        materials=dict(zip(names, materials)),
        dirichlet=(Dirichlet("bottom", z=0.0), *planes, *top),
        contact=tuple(pairs),
        tractions=() if pressure is None else (Traction("top", (0.0, 0.0, -float(pressure))),),
        symmetry=4,
    )


def patch(
    lower: Material = Material(young=1.0, poisson=0.3),
    upper: Material = Material(young=3.0, poisson=0.2),
    displacement: float = 0.01,
    order: int = 1,
    cells: Sequence[int] = (2, 2, 4),
) -> Scene:
    """Contact patch test: a `stack` of two blocks of side and height 1, with uniform pressure p = u / (h/E1 + h/E2).

    Local.  Other arguments as in `stack`.  Raises errors as `stack`.
    """
    return stack((lower, upper), displacement, order=order, cells=cells)
