"""A stiff cube pressed into a soft block: the paper's second benchmark, affine geometry."""

from fx_contact.problem.boundary_conditions import Dirichlet
from fx_contact.problem.materials import Material
from fx_contact.problem.scene import ContactPair, Scene
from fx_contact.scenes.arguments import check_arguments
from fx_contact.scenes.boxes import DOWN, FRONT, LEFT, UP, Boxes
from fx_contact.scenes.symmetry import sideways


def indentation(
    side=1.0,
    displacement=0.01,
    block=Material(young=1.0, poisson=0.3),
    cube=Material(young=100.0, poisson=0.3),
    order=1,
    coarse=4,
    symmetry="quarter",
):
    """A cube of side H on a block 3 H x 3 H x H; the cube's top moves down, the block's bottom is held vertically.

    Local.  The meshes match on the contact surface, the initial gap is zero.

    Args:
        side: H [m].
        displacement: of the cube's top [m].
        block, cube: materials.
        order: of the root mesh, 1 to 6; the geometry is affine.
        coarse: root cells along H, even.
        symmetry: "quarter" models x, y >= 0, "full" the whole.

    Returns:
        Scene.

    Raises:
        SceneError, GeometryError: an argument outside its range.
    """
    check_arguments(order, coarse, {"side": side}, {"displacement": displacement}, symmetry, even=True)
    return Scene(
        name="indentation",
        mesh=cube_on_block(order, coarse, symmetry, lambda body, points: side * points),
        materials={"block": block, "cube": cube},
        dirichlet=(
            Dirichlet("bottom", z=0.0),
            Dirichlet("top", z=-float(displacement)),
            *sideways(symmetry, ("block", "cube")),
        ),
        contact=(ContactPair("footprint", "base", direction=(0.0, 0.0, 1.0)),),
        symmetry=4 if symmetry == "quarter" else 1,
    )


def cube_on_block(order, coarse, symmetry, place):
    """Root mesh of a cube of side 1 on a block 3 x 3 x 1; its base and the block's footprint match.

    Local.

    Args:
        order: of the root mesh.
        coarse: root cells along the cube's side, even.
        symmetry: "quarter" or "full".
        place: where the points are, as in `Boxes.mesh`.

    Returns:
        RootMesh with bodies "block" and "cube".
    """
    quarter = symmetry == "quarter"
    low = 0.0 if quarter else -1.0
    boxes = Boxes(order)
    for name, half, bottom in (("block", 1.5, -1.0), ("cube", 0.5, 0.0)):
        width = round((half - low * half) * coarse)
        boxes.add(name, (low * half, low * half, bottom), (half, half, bottom + 1.0), (width, width, coarse))
    surfaces = {
        "bottom": boxes.facets(DOWN, -1.0),
        "top": boxes.facets(UP, 1.0),
        "footprint": boxes.facets(UP, 0.0, "block", within=0.5),
        "base": boxes.facets(DOWN, 0.0, "cube"),
    }
    if quarter:
        return boxes.mesh(
            surfaces | {"x = 0": boxes.facets(LEFT, 0.0), "y = 0": boxes.facets(FRONT, 0.0)}, place=place
        )
    curves = {
        "block axis": boxes.vertical_edges("block", (0.0, 0.0)),
        "cube axis": boxes.vertical_edges("cube", (0.0, 0.0)),
        "block side": boxes.vertical_edges("block", (1.5, 0.0)),
        "cube side": boxes.vertical_edges("cube", (0.5, 0.0)),
    }
    return boxes.mesh(surfaces, curves, place)
