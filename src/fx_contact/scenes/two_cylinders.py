"""Two parallel cylinders pressed together: contact along a line, a two-dimensional problem in three dimensions."""

import numpy as np

from fx_contact.problem.boundary_conditions import Dirichlet, SymmetryPlane
from fx_contact.problem.contact import ContactPair
from fx_contact.problem.materials import Material
from fx_contact.problem.scene import Scene
from fx_contact.scenes.arguments import check_arguments
from fx_contact.scenes.facing_columns import columns_mesh
from fx_contact.scenes.roundness import sagitta


def cylinders(
    radii=(1.0, 1.0),
    displacement=0.01,
    length=0.125,
    lower=Material(young=1.0, poisson=0.3),
    upper=Material(young=1.0, poisson=0.3),
    order=3,
    coarse=4,
):
    """Two bars with cylindrical faces along y, pressed together along z, between planes of symmetry y = 0 and length.

    Local.  Half (x >= 0) of a slice is modelled: plane strain, whatever its length, so that a thin slice will do; one
    root cell along y.  The record's `contact_radius` is None here.  Exact for small contacts:
    `analytic.HertzLine`.

    Args:
        radii: of the lower and the upper cylinder [m].
        displacement: approach of the bars' flat faces [m].
        length: of the slice [m].
        lower, upper: materials.
        order: of the root mesh, 2 to 6 for round faces.
        coarse: root cells along half a bar's width.

    Returns:
        Scene; its bodies are "lower" and "upper".

    Raises:
        SceneError, GeometryError: an argument outside its range.
    """
    lengths = dict(zip(("radius of the lower cylinder", "radius of the upper"), radii)) | {"length": length}
    check_arguments(order, coarse, lengths, {"displacement": displacement}, least_order=2)
    side = min(radii)

    def place(body, x):
        """From the boxes to the cylinders: layers bend towards the contact, the flat faces stay flat."""
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
