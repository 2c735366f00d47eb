"""A ring shrunk onto another: curved surfaces in contact along their normals."""

from collections.abc import Sequence

from fx_contact.geometry.shapes import root_mesh_from_shapes
from fx_contact.geometry.solids import ring
from fx_contact.items.boundary_conditions import SymmetryPlane
from fx_contact.items.contact import ContactPair
from fx_contact.items.materials import Material
from fx_contact.parallel.errors import SceneError
from fx_contact.scene.scene import Scene
from fx_contact.scenes.arguments import check_arguments


def shrink_fit(
    radii: Sequence[float] = (0.5, 1.0, 1.5),
    interference: float = 0.01,
    height: float = 0.25,
    inner: Material = Material(young=1.0, poisson=0.3),
    outer: Material = Material(young=1.0, poisson=0.3),
    order: int = 3,
    coarse: int = 3,
) -> Scene:
    """Two concentric rings about z, "inner" and "outer", the inner one too large for the outer one.

    Local.  A quarter is modelled, between the plane of symmetry z = 0 and the free upper end.  There are no other loads
    or supports.  Exact solution: `analytic.ShrinkFit`.  Raises SceneError or GeometryError for an argument out of
    range.

    Args:
        radii: inner radius, radius of the common surface, outer radius [m]; each ring deviates from the common radius
            by half the interference.
        interference: outer radius of the inner ring minus inner radius of the outer ring, unloaded [m]; negative for a
            clearance.
        height: modelled, half that of the rings [m].
        order: of the root mesh, 2 to 6.
        coarse: root cells across each ring; twice as many around the quarter.
    """
    lengths = dict(zip(("inner radius", "common radius", "outer radius"), radii)) | {"height": height}
    check_arguments(order, coarse, lengths, {"interference": interference}, least_order=2)
    bore, common, rim = radii
    half = interference / 2
    ends = {"inner": (bore, common + half), "outer": (common - half, rim)}
    if any(not 0 < low < high for low, high in ends.values()):
        raise SceneError(f"an interference of {interference} leaves no ring between the radii {tuple(radii)}")
    bodies = {name: ring(*pair, height, (coarse, 2 * coarse, 1), order, quarters=1) for name, pair in ends.items()}
    surfaces: dict[str, str | list[str]]
    surfaces = {"bore": "inner inside", "shaft": "inner outside", "hub": "outer inside", "rim": "outer outside"}
    for name, side in {"x = 0": "x = 0", "y = 0": "y = 0", "z = 0": "bottom", "end": "top"}.items():
        surfaces[name] = [f"{body} {side}" for body in ends]
    return Scene(
        name="shrink fit",
        mesh=root_mesh_from_shapes(bodies, surfaces),
        materials={"inner": inner, "outer": outer},
        dirichlet=tuple(SymmetryPlane(f"{axis} = 0") for axis in "xyz"),
        contact=(ContactPair("shaft", "hub"),),
        symmetry=8,
    )
