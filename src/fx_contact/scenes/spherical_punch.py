"""A punch with a spherical end pressed into a block, by a displacement or by a force."""

import numpy as np

from fx_contact.items.boundary_conditions import Dirichlet, Traction
from fx_contact.items.contact import ContactPair
from fx_contact.items.materials import Material
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import SceneError
from fx_contact.results.analytic import Hertz
from fx_contact.scene.scene import Scene
from fx_contact.scenes.arguments import check_arguments
from fx_contact.scenes.cube_indentation import cube_on_block
from fx_contact.scenes.round_bodies import check_roundness, sagitta
from fx_contact.scenes.symmetry import sideways


def punch(
    radius: float = 1.0,
    displacement: float = 0.01,
    force: float | None = None,
    side: float | None = None,
    block: Material = Material(young=1.0, poisson=0.3),
    punch: Material = Material(young=1.0, poisson=0.3),
    gap: float = 0.0,
    order: int = 2,
    coarse: int = 4,
    symmetry: str = "quarter",
) -> Scene:
    """A square punch with a spherical end, "cube", on a "block" three times as wide, whose bottom is fixed vertically.

    Local.  The punch is as high as wide.  Its end touches the block in one point or is `gap` above it.  Under a force
    only contact supports it vertically.  Raises SceneError or GeometryError for an argument out of range, or a root
    mesh too coarse for so small a load.

    Args:
        radius: of the spherical end [m].
        displacement: of the punch's top, downwards [m]; unused with a force.
        force: on the top of the whole punch, downwards and uniform [N]; None: the displacement is prescribed.
        side: width and height of the punch, below sqrt(2) radius [m]; None: the radius.
        gap: initial distance between the end and the block [m], negative for a penetration.
        order: of the root mesh, 2 to 6 for a round end.
        coarse: root cells along the side, even.
        symmetry: "quarter" models x, y >= 0, "full" the whole.
    """
    side = radius if side is None else side
    numbers = {"displacement": displacement, "gap": gap, "force": force or 0.0}
    check_arguments(order, coarse, {"radius": radius, "side": side}, numbers, symmetry, even=True)
    if side >= np.sqrt(2) * radius:
        raise SceneError(f"a punch of side {side} has no end of radius {radius}: at most sqrt(2) radius")

    def end(x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position with the lower face of the cube on the sphere."""
        rise = sagitta(x[0] ** 2 + x[1] ** 2, 1 / radius)
        return x[0], x[1], x[2] + (gap + rise * (1 - x[2] / side))

    supports = Dirichlet("bottom", z=0.0), *sideways(symmetry, ("block", "cube"))
    scene = Scene(
        name="punch",
        mesh=cube_on_block(order, coarse, symmetry, side, end),
        materials={"block": block, "cube": punch},
        dirichlet=supports if force is not None else (Dirichlet("top", z=-float(displacement)), *supports),
        contact=(ContactPair("footprint", "base", direction=(0.0, 0.0, 1.0)),),
        tractions=() if force is None else (Traction("top", (0.0, 0.0, -float(force) / side**2)),),
        symmetry=4 if symmetry == "quarter" else 1,
        contact_centre=(0.0, 0.0, 0.0),
    )
    modulus = 1 / (1 / block.plane_strain_modulus + 1 / punch.plane_strain_modulus)
    approach = displacement - gap if force is None else Hertz(radius, modulus, max(force, 0.0)).approach
    if approach > 0:
        contact_radius = np.sqrt(radius * approach)
        check_roundness(scene.mesh, "base", (0.0, 0.0, gap + radius), radius, contact_radius, approach)
    return scene
