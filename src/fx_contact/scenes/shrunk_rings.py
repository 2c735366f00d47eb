"""A ring shrunk onto another: contact of curved surfaces that face each other along their normals."""

from fx_contact.parallel.errors import SceneError
from fx_contact.problem.boundary_conditions import SymmetryPlane
from fx_contact.problem.contact import ContactPair
from fx_contact.problem.materials import Material
from fx_contact.problem.scene import Scene
from fx_contact.problem.shapes import root_mesh_from_shapes
from fx_contact.problem.solids import ring
from fx_contact.scenes.arguments import check_arguments


def shrink_fit(
    radii=(0.5, 1.0, 1.5),
    interference=0.01,
    height=0.25,
    inner=Material(young=1.0, poisson=0.3),
    outer=Material(young=1.0, poisson=0.3),
    order=3,
    coarse=3,
):
    """Two concentric rings about z of which the inner one is too large: they press each other apart.

    Local.  A quarter is modelled, of which z = 0 is a plane of symmetry and the upper end is free.  Nothing else holds
    or loads the rings but each other.  Exact: `analytic.ShrinkFit`.

    Args:
        radii: inner radius, radius of the common surface, outer radius [m]; each ring is off the common one by half the
            interference.
        interference: by which the inner ring's outer radius exceeds the outer ring's inner radius, unloaded [m];
            negative for a clearance.
        height: modelled, half that of the rings [m].
        inner, outer: materials.
        order: of the root mesh, 2 to 6.
        coarse: root cells across each ring; twice as many around the quarter.

    Returns:
        Scene; its bodies are "inner" and "outer".

    Raises:
        SceneError, GeometryError: an argument outside its range.
    """
    lengths = dict(zip(("inner radius", "common radius", "outer radius"), radii)) | {"height": height}
    check_arguments(order, coarse, lengths, {"interference": interference}, least_order=2)
    bore, common, rim = radii
    half = interference / 2
    ends = {"inner": (bore, common + half), "outer": (common - half, rim)}
    if any(not 0 < low < high for low, high in ends.values()):
        raise SceneError(f"an interference of {interference} leaves no ring between the radii {tuple(radii)}")
    bodies = {name: ring(*pair, height, (coarse, 2 * coarse, 1), order, quarters=1) for name, pair in ends.items()}
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
