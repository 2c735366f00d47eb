"""Indentation of a soft block by a stiff cube: the paper's second benchmark, affine geometry."""

import numpy as np

from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.geometry.shapes import Placement, Predicate, root_mesh_from_shapes
from fx_contact.geometry.solids import block
from fx_contact.items.boundary_conditions import Dirichlet
from fx_contact.items.contact import ContactPair
from fx_contact.items.materials import Material
from fx_contact.scene.scene import Scene
from fx_contact.scenes.arguments import check_arguments
from fx_contact.scenes.symmetry import sideways


def indentation(
    side: float = 1.0,
    displacement: float = 0.01,
    block: Material = Material(young=1.0, poisson=0.3),
    cube: Material = Material(young=100.0, poisson=0.3),
    order: int = 1,
    coarse: int = 4,
    symmetry: str = "quarter",
) -> Scene:
    """A cube of side H on a block 3 H x 3 H x H, pressed down at its top; the block's bottom is fixed vertically.

    Local.  The meshes match on the contact surface, the initial gap is zero.  Raises SceneError or GeometryError for an
    argument out of range.

    Args:
        side: H [m].
        displacement: of the cube's top, downwards [m].
        order: of the root mesh, 1 to 6; the geometry is affine.
        coarse: root cells along H, even.
        symmetry: "quarter" models x, y >= 0, "full" the whole.
    """
    check_arguments(order, coarse, {"side": side}, {"displacement": displacement}, symmetry, even=True)
    vertical = Dirichlet("bottom", z=0.0), Dirichlet("top", z=-float(displacement))
    return Scene(
        name="indentation",
        mesh=cube_on_block(order, coarse, symmetry, side),
        materials={"block": block, "cube": cube},
        dirichlet=(*vertical, *sideways(symmetry, ("block", "cube"))),
        contact=(ContactPair("footprint", "base", direction=(0.0, 0.0, 1.0)),),
        symmetry=4 if symmetry == "quarter" else 1,
    )


def cube_on_block(order: int, coarse: int, symmetry: str, side: float, end: Placement | None = None) -> RootMesh:
    """Root mesh of "cube" on a "block" three times as wide, with matching meshes; `end` moves the cube's nodes.

    Local.  Other arguments as in `indentation`.  Raises errors of `block` and `Shape.placed`.
    """
    quarter = symmetry == "quarter"
    low, bodies = 0.0 if quarter else -1.0, {}
    for name, half, bottom in (("block", 1.5, -1.0), ("cube", 0.5, 0.0)):
        width = round((half - low * half) * coarse)
        unit = block((low * half, low * half, bottom), (half, half, bottom + 1.0), (width, width, coarse), order)
        bodies[name] = unit.named("footprint", "top", where=lambda x: (np.abs(x[:2]) < 0.5 + 1e-9).all(axis=0))
        bodies[name] = bodies[name].placed(lambda x: side * x)
    if end is not None:
        bodies["cube"] = bodies["cube"].placed(end)
    surfaces: dict[str, str | list[str]]
    surfaces = {"bottom": "block bottom", "top": "cube top", "footprint": "block footprint", "base": "cube bottom"}
    if quarter:
        surfaces |= {"x = 0": ["block left", "cube left"], "y = 0": ["block front", "cube front"]}
        return root_mesh_from_shapes(bodies, surfaces)

    def along_z(body: str, at: float) -> tuple[str, Predicate]:
        """The edges of a body along z at x = at, y = 0, relative to the side."""
        return body, lambda x: (np.abs(x[0] - side * at) < 1e-9 * side) & (np.abs(x[1]) < 1e-9 * side)

    curves = {f"{body} axis": along_z(body, 0.0) for body in bodies}
    curves |= {"block side": along_z("block", 1.5), "cube side": along_z("cube", 0.5)}
    return root_mesh_from_shapes(bodies, surfaces, curves)
