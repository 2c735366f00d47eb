"""Two columns whose ends meet: the root meshes of round bodies that touch at a pole or along a line."""

from functools import partial

from fx_contact.problem.shapes import root_mesh_from_shapes
from fx_contact.problem.solids import block


def columns_mesh(order, cells, depth, end, place):
    """Two columns 0.5 x depth x 1 along z, whose ends meet in the plane z = 0, placed.

    Local.

    Args:
        order: of the cell maps.
        cells: of each column along x, y, z.
        depth: along y [-].
        end: what the meeting ends are called.
        place: function of a body's name and its (3, n) float64 points [-] that says where they are [m].

    Returns:
        RootMesh with bodies "lower" and "upper" and the surfaces "bottom", "top", "lower END", "upper END", "x = 0",
        "y = 0" and "y = length".
    """
    bodies = {
        name: block((0.0, 0.0, low), (0.5, depth, low + 1.0), cells, order).placed(partial(place, name))
        for name, low in (("lower", -1.0), ("upper", 0.0))
    }
    surfaces = {
        "bottom": "lower bottom",
        "top": "upper top",
        f"lower {end}": "lower top",
        f"upper {end}": "upper bottom",
    }
    for plane, side in (("x = 0", "left"), ("y = 0", "front"), ("y = length", "back")):
        surfaces[plane] = [f"{body} {side}" for body in bodies]
    return root_mesh_from_shapes(bodies, surfaces)
