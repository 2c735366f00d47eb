"""Two bodies with spherical ends of different radii: Hertz's contact with one effective radius."""

from collections.abc import Sequence

import numpy as np

from fx_contact.items.boundary_conditions import Dirichlet, SymmetryPlane
from fx_contact.items.contact import ContactPair
from fx_contact.items.materials import Material
from fx_contact.parallel.errors import SceneError
from fx_contact.scene.scene import Scene
from fx_contact.scenes.arguments import check_arguments
from fx_contact.scenes.round_bodies import check_roundness, columns_mesh


def spheres(
    radii: Sequence[float] = (1.0, 2.0),
    displacement: float = 0.01,
    side: float | None = None,
    lower: Material = Material(young=1.0, poisson=0.3),
    upper: Material = Material(young=1.0, poisson=0.3),
    order: int = 3,
    coarse: int = 4,
) -> Scene:
    """Two square columns with spherical ends, "lower" and "upper", pressed together pole to pole.

    Local.  A quarter is modelled.  The meshes of the ends match for all radii: an infinite radius is a flat end (a
    sphere on a block), a negative one a hollow end (a ball in a socket).  Raises SceneError or GeometryError for an
    argument out of range, or a root mesh too coarse for so small a displacement.

    Args:
        radii: of the lower and the upper end [m]; 1/R1 + 1/R2 = 1/R* must be positive.
        displacement: approach of the columns' flat ends [m]; the lower one is fixed vertically.
        side: width and height of each column [m]; None: the smaller radius.
        order: of the root mesh, 2 to 6 for round ends.
        coarse: root cells along half a side.
    """
    if 0 in radii:
        raise SceneError(f"radii must be two numbers but 0, infinity for a flat end, got {tuple(radii)}")
    curvature = 1 / np.array(radii, dtype=np.float64)
    if not curvature.sum() > 0:
        raise SceneError(f"ends of radii {tuple(radii)} do not touch in one point: 1/R1 + 1/R2 must be positive")
    radius = 1 / np.abs(curvature).max()
    side = radius if side is None else side
    check_arguments(order, coarse, {"radius": radius, "side": side}, {"displacement": displacement})
    if side / radius >= np.sqrt(2):
        raise SceneError(f"a column of side {side} has no end of radius {radius}: take a smaller side")
    mesh = columns_mesh(order, (coarse,) * 3, "end", side, curvature)
    contact_radius = np.sqrt(max(displacement, 0.0) / curvature.sum())  # Hertz: a^2 = R* delta
    for end, bend, sign in (("lower end", curvature[0], -1), ("upper end", curvature[1], 1)):
        if bend:
            share = displacement * abs(bend) / np.abs(curvature).sum()
            check_roundness(mesh, end, (0.0, 0.0, sign / bend), abs(1 / bend), contact_radius, share)
    vertical = Dirichlet("bottom", z=0.0), Dirichlet("top", z=-float(displacement))
    return Scene(
        name="spheres",
        mesh=mesh,
        materials={"lower": lower, "upper": upper},
        dirichlet=(*vertical, SymmetryPlane("x = 0"), SymmetryPlane("y = 0")),
        contact=(ContactPair("lower end", "upper end", direction=(0.0, 0.0, 1.0)),),
        symmetry=4,
        contact_centre=(0.0, 0.0, 0.0),
    )
