"""Two parallel cylinders pressed together: line contact, a two-dimensional problem in three dimensions."""

from collections.abc import Sequence

import numpy as np

from fx_contact.items.boundary_conditions import Dirichlet, SymmetryPlane
from fx_contact.items.contact import ContactPair
from fx_contact.items.materials import Material
from fx_contact.scene.scene import Scene
from fx_contact.scenes.arguments import check_arguments
from fx_contact.scenes.round_bodies import columns_mesh


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
    curvatures = 1 / np.array(radii, dtype=np.float64)
    planes = tuple(SymmetryPlane(name) for name in ("x = 0", "y = 0", "y = length"))
    return Scene(
        name="cylinders",
        mesh=columns_mesh(order, (coarse, 1, 2 * coarse), "face", min(radii), curvatures, length),
        materials={"lower": lower, "upper": upper},
        dirichlet=(Dirichlet("bottom", z=0.0), Dirichlet("top", z=-float(displacement)), *planes),
        contact=(ContactPair("lower face", "upper face", direction=(0.0, 0.0, 1.0)),),
        symmetry=2,
    )
