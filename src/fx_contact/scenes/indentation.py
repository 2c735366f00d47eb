"""A stiff cube pressed into a soft block: the paper's second benchmark, affine geometry."""

import numpy as np

from fx_contact import reference
from fx_contact.errors import SceneError
from fx_contact.rootmesh import RootMesh
from fx_contact.scene import ContactPair, Dirichlet, Material, Scene
from fx_contact.scenes.arguments import check_mesh_size, check_number, check_symmetry

#: Local faces of a box cell by where they look.
_DOWN, _FRONT, _LEFT, _UP = 0, 1, 2, 5


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
    check_symmetry(symmetry)
    check_number("side", side, positive=True)
    check_number("displacement", displacement)
    check_mesh_size(order, coarse)
    if coarse % 2:
        raise SceneError(f"coarse must be even, for a vertex on the axis, got {coarse}")
    quarter = symmetry == "quarter"
    low = 0.0 if quarter else -1.0
    lower = box([low * 1.5, low * 1.5, -1.0], [1.5, 1.5, 0.0], coarse, order)
    upper = box([low * 0.5, low * 0.5, 0.0], [0.5, 0.5, 1.0], coarse, order)
    return Scene(
        name="indentation",
        mesh=_join(lower, upper, side, quarter),
        materials={"block": block, "cube": cube},
        dirichlet=(Dirichlet("bottom", z=0.0), Dirichlet("top", z=-float(displacement)), *_sideways(quarter)),
        contact=(ContactPair("footprint", "base", direction=(0.0, 0.0, 1.0)),),
        symmetry=4 if quarter else 1,
    )


def _sideways(quarter):
    """Conditions that stop sideways motion: symmetry planes, or by symmetry the axis and a vertical line of each body.

    Where lines would do, single vertices would too, but hold so softly that PCG needs twice the iterations.
    """
    if quarter:
        return Dirichlet("x = 0", x=0.0), Dirichlet("y = 0", y=0.0)
    return tuple(
        condition
        for body in ("block", "cube")
        for condition in (Dirichlet(f"{body} axis", x=0.0, y=0.0), Dirichlet(f"{body} side", y=0.0))
    )


def box(low, high, coarse, order):
    """Nodes and cells of a structured box: (n, 3) float64 in units of H, (m, (p+1)^3) int64 in tensor order."""
    counts = np.rint((np.array(high) - low) * coarse).astype(np.int64)
    axes = [np.linspace(a, b, order * n + 1) for a, b, n in zip(low, high, counts)]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    strides = np.cumprod([1, order * counts[0] + 1, order * counts[1] + 1])
    corner = np.stack(np.meshgrid(*[np.arange(n) for n in counts[::-1]], indexing="ij")[::-1], axis=-1).reshape(-1, 3)
    cells = (order * corner) @ strides
    return np.stack([x, y, z], axis=-1).reshape(-1, 3), cells[:, None] + reference.lattice(order) @ strides


def _join(lower, upper, side, quarter):
    """The root mesh of block and cube, faces and vertices named by where they are."""
    points = np.concatenate([lower[0], upper[0]])
    cells = np.concatenate([lower[1], upper[1] + len(lower[0])])
    body = np.repeat(np.array([0, 1], dtype=np.int32), [len(lower[1]), len(upper[1])])
    low, high = points[cells[:, 0]], points[cells[:, -1]]
    under_cube = (body == 0) & (np.abs(low + high)[:, :2] < 1).all(axis=1)

    def facets(cells_with_it, face, level):
        axis, end = reference.FACE_AXIS[face], (low, high)[reference.FACE_SIDE[face]]
        cell = np.flatnonzero(cells_with_it & (np.abs(end[:, axis] - level) < 1e-9))
        return np.stack([cell, np.full(len(cell), face)], axis=1).astype(np.int32)

    everywhere = np.ones(len(cells), dtype=bool)
    surfaces = {
        "bottom": facets(everywhere, _DOWN, -1.0),
        "top": facets(everywhere, _UP, 1.0),
        "footprint": facets(under_cube, _UP, 0.0),
        "base": facets(body == 1, _DOWN, 0.0),
    }
    if quarter:
        surfaces |= {"x = 0": facets(everywhere, _LEFT, 0.0), "y = 0": facets(everywhere, _FRONT, 0.0)}
        curves = {}
    else:
        curves = {
            "block axis": _vertical_edges(high, body == 0, (0.0, 0.0)),
            "cube axis": _vertical_edges(high, body == 1, (0.0, 0.0)),
            "block side": _vertical_edges(high, body == 0, (1.5, 0.0)),
            "cube side": _vertical_edges(high, body == 1, (0.5, 0.0)),
        }
    return RootMesh(side * points, cells, ("block", "cube"), body, surfaces, curves=curves)


def _vertical_edges(high, cells_with_it, place):
    """Rows (cell, local edge) of the edges above one place of the plane, from the cells whose far corner is there."""
    cell = np.flatnonzero(cells_with_it & (np.abs(high[:, :2] - place) < 1e-9).all(axis=1))
    edge = np.flatnonzero((reference.EDGE_CORNERS == [3, 7]).all(axis=1))[0]
    return np.stack([cell, np.full(len(cell), edge)], axis=1).astype(np.int32)
