"""A ring shrunk onto another: contact of curved surfaces that face each other along their normals."""

import numpy as np

from fx_contact.parallel.errors import SceneError
from fx_contact.problem.boundary_conditions import SymmetryPlane
from fx_contact.problem.materials import Material
from fx_contact.problem.scene import ContactPair, Scene
from fx_contact.scenes.arguments import check_arguments
from fx_contact.scenes.boxes import BACK, DOWN, FRONT, LEFT, RIGHT, UP, Boxes


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
    boxes = Boxes(order)
    for start, body in enumerate(ends):
        boxes.add(body, (start, 0.0, 0.0), (start + 1.0, 1.0, 1.0), (coarse, 2 * coarse, 1))

    def place(body, points):
        """From the boxes to a quarter of the rings: across, around and along."""
        low, high = ends[body]
        across, around, along = points.T
        radius, angle = low + (across - across.min()) * (high - low), np.pi / 2 * around
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), height * along], axis=1)

    surfaces = {
        "bore": boxes.facets(LEFT, 0.0),
        "shaft": boxes.facets(RIGHT, 1.0, "inner"),
        "hub": boxes.facets(LEFT, 1.0, "outer"),
        "rim": boxes.facets(RIGHT, 2.0),
        "x = 0": boxes.facets(BACK, 1.0),
        "y = 0": boxes.facets(FRONT, 0.0),
        "z = 0": boxes.facets(DOWN, 0.0),
        "end": boxes.facets(UP, 1.0),
    }
    return Scene(
        name="shrink fit",
        mesh=boxes.mesh(surfaces, place=place),
        materials={"inner": inner, "outer": outer},
        dirichlet=tuple(SymmetryPlane(f"{axis} = 0") for axis in "xyz"),
        contact=(ContactPair("shaft", "hub"),),
        symmetry=8,
    )
