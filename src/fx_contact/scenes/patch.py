"""Two columns end to end under a uniform pressure: the patch test of contact, with an exact solution."""

import numpy as np

from fx_contact import reference
from fx_contact.rootmesh import RootMesh
from fx_contact.scene import ContactPair, Dirichlet, Material, Scene
from fx_contact.scenes.arguments import check_mesh_size, check_number
from fx_contact.scenes.indentation import box


def patch(
    displacement=0.01, lower=Material(young=1.0, poisson=0.3), upper=Material(young=3.0, poisson=0.2), coarse=2
):
    """A column of side 1 and height 1 on another, pressed together; a quarter is modelled.

    Local.  Both widen freely, each as its material wants: the surfaces slide on each other.

    Args:
        displacement: of the upper column's top, downwards [m].
        lower, upper: materials.
        coarse: root cells along half a side.

    Returns:
        Scene.

    Raises:
        SceneError, GeometryError: an argument outside its range.
    """
    check_number("displacement", displacement)
    check_mesh_size(1, coarse)
    below, above = (box([0, 0, low], [0.5, 0.5, low + 1.0], 2 * coarse, 1) for low in (-1.0, 0.0))
    points = np.concatenate([below[0], above[0]])
    cells = np.concatenate([below[1], above[1] + len(below[0])])
    body = np.repeat(np.array([0, 1], dtype=np.int32), [len(below[1]), len(above[1])])
    centres = points[cells[:, reference.FACE_CORNERS]].mean(axis=2)

    def facets(axis, at, which=(0, 1)):
        on = (np.abs(centres[:, :, axis] - at) < 1e-9) & np.isin(body, which)[:, None]
        return np.argwhere(on).astype(np.int32)

    surfaces = {"x = 0": facets(0, 0), "y = 0": facets(1, 0), "bottom": facets(2, -1), "top": facets(2, 1)}
    surfaces |= {"under": facets(2, 0, [0]), "over": facets(2, 0, [1])}
    held = Dirichlet("bottom", z=0.0), Dirichlet("top", z=-float(displacement))
    return Scene(
        name="patch",
        mesh=RootMesh(points, cells, ("lower", "upper"), body, surfaces),
        materials={"lower": lower, "upper": upper},
        dirichlet=(*held, Dirichlet("x = 0", x=0.0), Dirichlet("y = 0", y=0.0)),
        contact=(ContactPair("under", "over", direction=(0.0, 0.0, 1.0)),),
        symmetry=4,
    )


def patch_pressure(scene):
    """Contact pressure of a `patch` scene, where nothing penetrates [Pa]: the displacement over both compliances.

    Local.
    """
    moved = next(c.z for c in scene.dirichlet if c.where == "top")
    return -moved / sum(1 / material.young for material in scene.materials.values())
