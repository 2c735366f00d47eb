"""Root meshes of two columns with facing ends, for round bodies that touch at a pole or along a line."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy.typing as npt

from fx_contact.parallel.arrays import FloatArray
from fx_contact.problem.root_mesh import RootMesh
from fx_contact.problem.shapes import root_mesh_from_shapes
from fx_contact.problem.solids import block


def columns_mesh(
    order: int,
    cells: Sequence[int],
    depth: float,
    end: str,
    place: Callable[[str, FloatArray], Sequence[npt.ArrayLike] | FloatArray],
) -> RootMesh:
    """Root mesh of two columns 0.5 x depth x 1 along z that meet in the plane z = 0, with cells along x, y, z.

    Local.  The bodies are "lower" and "upper", the surfaces "bottom", "top", "lower END", "upper END", "x = 0", "y = 0"
    and "y = length".

    Args:
        place: maps the name of a body and points (3, n) [-] of it to their positions [m].
    """
    bodies = {
        name: block((0.0, 0.0, low), (0.5, depth, low + 1.0), cells, order).placed(partial(place, name))
        for name, low in (("lower", -1.0), ("upper", 0.0))
    }
    surfaces: dict[str, str | list[str]] = {"bottom": "lower bottom", "top": "upper top"}
    surfaces |= {f"lower {end}": "lower top", f"upper {end}": "upper bottom"}
    for plane, side in (("x = 0", "left"), ("y = 0", "front"), ("y = length", "back")):
        surfaces[plane] = [f"{body} {side}" for body in bodies]
    return root_mesh_from_shapes(bodies, surfaces)
