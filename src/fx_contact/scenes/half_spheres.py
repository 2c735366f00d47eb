"""Two half-spheres pressed together: Hertz's problem on finite bodies."""

import numpy as np

from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.geometry.shapes import root_mesh_from_shapes
from fx_contact.geometry.solids import ball
from fx_contact.items.boundary_conditions import Dirichlet
from fx_contact.items.contact import ContactPair
from fx_contact.items.materials import Material
from fx_contact.parallel.arrays import BoolArray, FloatArray
from fx_contact.scene.scene import Scene
from fx_contact.scenes.arguments import check_arguments
from fx_contact.scenes.round_bodies import check_roundness
from fx_contact.scenes.symmetry import sideways

#: Distance of nodes from lines and planes, relative to the radius: rounding.
_ON = 1e-9


def hertz(
    radius: float = 1.0,
    displacement: float = 0.01,
    material: Material = Material(young=1.0, poisson=0.3),
    order: int = 3,
    coarse: int = 4,
    symmetry: str = "quarter",
) -> Scene:
    """Two equal half-spheres pressed together, pole to pole, by the displacement of their flat faces, half on each.

    Local.  The flat faces are free laterally; the gap is measured along z.  Raises SceneError or GeometryError for an
    argument out of range, or a root mesh too coarse for so small a displacement.

    Args:
        radius: of both spheres [m].
        displacement: approach of the flat faces [m].
        material: of both.
        order: of the root mesh, 1 to 6.
        coarse: root cells along the side of a block of the half-ball.
        symmetry: "quarter" models x, y >= 0, "full" the whole half-spheres.
    """
    check_arguments(order, coarse, {"radius": radius}, {"displacement": displacement}, symmetry)
    mesh, half = _half_balls(float(radius), order, coarse, symmetry), displacement / 2
    if displacement > 0:  # Hertz: a^2 = R* delta; half of the approach for each sphere
        contact_radius = np.sqrt(radius / 2 * displacement)
        check_roundness(mesh, "upper pole", (0.0, 0.0, radius), radius, contact_radius, half)
    flat_faces = Dirichlet("top", z=-half), Dirichlet("bottom", z=half)
    return Scene(
        name="hertz",
        mesh=mesh,
        materials={"lower": material, "upper": material},
        dirichlet=(*flat_faces, *sideways(symmetry, ("lower", "upper"), "radius")),
        contact=(ContactPair("lower pole", "upper pole", direction=(0.0, 0.0, 1.0)),),
        symmetry=4 if symmetry == "quarter" else 1,
        contact_centre=(0.0, 0.0, 0.0),
    )


def _half_balls(radius: float, order: int, coarse: int, symmetry: str) -> RootMesh:
    """Half-balls that touch at the origin, with flat faces at z = -radius and z = radius."""
    rounding = _ON * radius

    def near_pole(x: FloatArray) -> BoolArray:
        """Within the block around the pole, in the frame of `ball`."""
        return np.abs(x[:2]).max(axis=0) <= (1 + _ON) * x[2]

    def axis(x: FloatArray) -> BoolArray:
        """On the axis of the half-balls."""
        return np.hypot(x[0], x[1]) < rounding

    def line(x: FloatArray) -> BoolArray:
        """On the flat face."""
        return (np.abs(x[1]) < rounding) & (np.abs(np.abs(x[2]) - radius) < rounding) & (x[0] >= -rounding)

    quarter = symmetry == "quarter"
    half = ball(radius, coarse, order, 1 if quarter else 4).named("pole", "outside", where=near_pole)
    bodies = {"lower": half.shifted(z=-radius), "upper": half.mirrored("z").shifted(z=radius)}
    surfaces: dict[str, str | list[str]] = {"bottom": "lower z = 0", "top": "upper z = 0"}
    if quarter:
        surfaces |= {plane: [f"{body} {plane}" for body in bodies] for plane in ("x = 0", "y = 0")}
        return root_mesh_from_shapes(bodies, surfaces)
    places = {"axis": axis, "radius": line}
    curves = {f"{body} {name}": (body, place) for body in bodies for name, place in places.items()}
    return root_mesh_from_shapes(bodies, surfaces, curves)
