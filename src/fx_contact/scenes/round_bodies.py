"""Round bodies: columns with facing ends, height above the tangent plane, geometric error relative to the approach."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from fx_contact.geometry.leaf_facets import CORNERS
from fx_contact.geometry.root_facets import RootFacets
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.geometry.shapes import root_mesh_from_shapes
from fx_contact.geometry.solids import block
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import GeometryError

#: Largest distance of a surface from its sphere, relative to the approach; half of it is the error of the force.
ROUND_ENOUGH = 0.05


def columns_mesh(
    order: int, cells: Sequence[int], end: str, side: float, curvatures: FloatArray, length: float | None = None
) -> RootMesh:
    """Root mesh of two columns along z with round ends that touch in the origin, with cells along x, y, z.

    Local.  The bodies are "lower" and "upper", the surfaces "bottom", "top", "lower END", "upper END", "x = 0", "y = 0"
    and "y = length".

    Args:
        side: height of each column, twice its width [m].
        curvatures: (2,), 1/R of the lower and the upper end, as of `sagitta` [1/m].
        length: of cylindrical ends along y [m]; None: spherical ones, of columns as deep as wide.

    Raises:
        SceneError, GeometryError: as `block`, `Shape.placed` and `RootMesh`.
    """
    scale = np.array([side, side if length is None else length, side])
    depth, across = (0.5, 2) if length is None else (1.0, 1)

    def place(bend: float, x: FloatArray) -> FloatArray:
        """Map from boxes to bodies: layers bend towards the contact, the flat faces stay flat."""
        placed = scale[:, None] * x
        placed[2] += sagitta((placed[:across] ** 2).sum(axis=0), bend) * (1 - np.abs(x[2]))
        return placed

    bodies = {
        name: block((0.0, 0.0, low), (0.5, depth, low + 1.0), cells, order).placed(partial(place, bend))
        for name, low, bend in (("lower", -1.0, -curvatures[0]), ("upper", 0.0, curvatures[1]))
    }
    surfaces: dict[str, str | list[str]] = {"bottom": "lower bottom", "top": "upper top"}
    surfaces |= {f"lower {end}": "lower top", f"upper {end}": "upper bottom"}
    for plane, wall in (("x = 0", "left"), ("y = 0", "front"), ("y = length", "back")):
        surfaces[plane] = [f"{body} {wall}" for body in bodies]
    return root_mesh_from_shapes(bodies, surfaces)


def sagitta(distance2: FloatArray, curvature: float) -> FloatArray:
    """Height R - sqrt(R^2 - r^2) [m] of a sphere above its tangent plane, without cancellation.

    Local.  Arguments are r^2 (n,) [m^2], and 1/R [1/m], 0 for a plane, negative for a hollow sphere.
    """
    return distance2 * curvature / (1 + np.sqrt(1 - distance2 * curvature**2))


def check_roundness(
    mesh: RootMesh, surface: str, centre: Sequence[float], radius: float, contact_radius: float, approach: float
) -> None:
    """Raises GeometryError if a surface deviates too much from its sphere within twice the contact radius.

    Local.  If the deviation is not small against the approach, the computed contact is that of the polynomials.  A mesh
    of order 1 is not checked: it stands for a polyhedron.

    Args:
        surface: name of the round surface, whose pole is a vertex.
        contact_radius, approach: expected by Hertz's theory [m].
    """
    if mesh.order == 1 or not approach > 0:
        return
    facets = mesh.surface(surface)
    corners = mesh.facet_points(facets, order=1)
    arm = np.hypot(*np.moveaxis(corners[:, :, :2] - centre[:2], 2, 0))
    facets, arm = facets[arm.min(axis=1) < 1e-6 * radius], arm[arm.min(axis=1) < 1e-6 * radius]
    steps = np.stack(np.meshgrid(*2 * [np.linspace(0, 1, 25)]), axis=-1).reshape(-1, 2)
    reach = np.minimum(1, 2 * contact_radius / arm.max(axis=1))[:, None, None]
    from_pole = np.abs(CORNERS[arm.argmin(axis=1)][:, None] - reach * steps)
    position = RootFacets(mesh, facets).at(np.arange(len(facets)), from_pole).position
    off = np.abs(np.linalg.norm(position - centre, axis=2) - radius).max()
    if off > ROUND_ENOUGH * approach:
        raise GeometryError(
            f"the root mesh of order {mesh.order} leaves the sphere of {surface!r} by {off:.2g} near the pole, which "
            f"is {off / approach:.0%} of the approach of {approach:.2g}: take a higher order or more root cells"
        )
