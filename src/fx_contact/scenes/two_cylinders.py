"""Two parallel cylinders pressed together: line contact, a two-dimensional problem in three dimensions."""

from collections.abc import Sequence

import numpy as np

from fx_contact.items.boundary_conditions import Dirichlet, SymmetryPlane
from fx_contact.items.contact import ContactPair
from fx_contact.items.materials import Material
from fx_contact.parallel.arrays import FloatArray
from fx_contact.scene.scene import Scene
from fx_contact.scenes.arguments import check_arguments
from fx_contact.scenes.round_bodies import columns_mesh, sagitta


def cylinders(
    radii: Sequence[float] = (1.0, 1.0),
    displacement: float = 0.01,
    length: float = 0.125,
    lower: Material = Material(young=1.0, poisson=0.3),
    upper: Material = Material(young=1.0, poisson=0.3),
    order: int = 3,
    coarse: int = 4,
) -> Scene:
    """Two bars with cylindrical faces along y, "lower" and "upper", pressed together along z in plane strain.

    Local.  Half (x >= 0) of a slice between the symmetry planes y = 0 and y = length is modelled, with one root cell
    along y; a thin slice suffices.  The record's `contact_radius` is None.  Exact for small contact areas:
    `analytic.HertzLine`.  Raises SceneError or GeometryError for an argument out of range.

    Args:
        radii: of the lower and the upper cylinder [m].
        displacement: approach of the bars' flat faces [m].
        length: of the slice [m].
        order: of the root mesh, 2 to 6 for round faces.
        coarse: root cells along half a bar's width.
    """
    lengths = dict(zip(("radius of the lower cylinder", "radius of the upper"), radii)) | {"length": length}
    check_arguments(order, coarse, lengths, {"displacement": displacement}, least_order=2)
    side = min(radii)

    def place(body: str, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Map from boxes to cylinders: layers bend towards the contact, the flat faces stay flat."""
        curvature = -1 / radii[0] if body == "lower" else 1 / radii[1]
        height = side * x[2] + sagitta((side * x[0]) ** 2, curvature) * (1 - np.abs(x[2]))
        return side * x[0], length * x[1], height

    planes = tuple(SymmetryPlane(name) for name in ("x = 0", "y = 0", "y = length"))
    return Scene(
        name="cylinders",
        mesh=columns_mesh(order, (coarse, 1, 2 * coarse), 1.0, "face", place),
        materials={"lower": lower, "upper": upper},
        dirichlet=(Dirichlet("bottom", z=0.0), Dirichlet("top", z=-float(displacement)), *planes),
        contact=(ContactPair("lower face", "upper face", direction=(0.0, 0.0, 1.0)),),
        symmetry=2,
    )
