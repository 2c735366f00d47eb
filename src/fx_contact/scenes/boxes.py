"""Bodies made of box cells: the structured root meshes of the ready scenes."""

import numpy as np

from fx_contact.problem import hexahedron
from fx_contact.problem.root_mesh import RootMesh

#: Local faces of a box cell by where they look.
DOWN, FRONT, LEFT, RIGHT, BACK, UP = range(6)


def facing_columns(order, cells, depth, end):
    """Two columns 0.5 x depth x 1 along z whose ends meet in the plane z = 0.

    Local.

    Args:
        order: of the cell maps.
        cells: of each column along x, y, z.
        depth: along y [-].
        end: what the meeting ends are called.

    Returns:
        Boxes with bodies "lower" and "upper"; dict of the surfaces "bottom", "top", "lower END", "upper END", "x = 0"
        and "y = 0".
    """
    boxes = Boxes(order)
    boxes.add("lower", (0.0, 0.0, -1.0), (0.5, depth, 0.0), cells)
    boxes.add("upper", (0.0, 0.0, 0.0), (0.5, depth, 1.0), cells)
    return boxes, {
        "bottom": boxes.facets(DOWN, -1.0),
        "top": boxes.facets(UP, 1.0),
        f"lower {end}": boxes.facets(UP, 0.0, "lower"),
        f"upper {end}": boxes.facets(DOWN, 0.0, "upper"),
        "x = 0": boxes.facets(LEFT, 0.0),
        "y = 0": boxes.facets(FRONT, 0.0),
    }


class Boxes:
    """Boxes of equal cells, each a body; facets and edges are found by their place in the boxes, before they are bent.

    Local.

    Args:
        order: of the cell maps.
    """

    def __init__(self, order):
        self._order = order
        self._points, self._cells, self._bodies, self._body = [], [], [], []
        self._count = 0

    def add(self, name, low, high, counts):
        """Add a body.

        Args:
            name: of the body.
            low, high: its corners (3,) [-].
            counts: cells along x, y, z.
        """
        order, counts = self._order, np.asarray(counts, dtype=np.int64)
        axes = [np.linspace(a, b, order * n + 1) for a, b, n in zip(low, high, counts)]
        z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
        strides = np.cumprod([1, order * counts[0] + 1, order * counts[1] + 1])
        corner = np.meshgrid(*[np.arange(n) for n in counts[::-1]], indexing="ij")[::-1]
        first = order * np.stack(corner, axis=-1).reshape(-1, 3) @ strides
        self._cells.append(self._count + first[:, None] + hexahedron.lattice(order) @ strides)
        self._points.append(np.stack([x, y, z], axis=-1).reshape(-1, 3))
        self._body.append(np.full(len(first), len(self._bodies), dtype=np.int32))
        self._bodies.append(name)
        self._count += x.size

    def facets(self, face, level, body=None, within=np.inf):
        """Faces of cells that look one way and lie in a plane.

        Args:
            face: `DOWN`, `UP`, ...
            level: of the plane along its normal [-].
            body: name of the only body to look at, or None.
            within: half width of the square about the z axis that the facets' centres lie in [-].

        Returns:
            (n, 2) int32 rows (cell, local face).
        """
        low, high = self._ends()
        axis, end = hexahedron.FACE_AXIS[face], (low, high)[hexahedron.FACE_SIDE[face]]
        here = np.abs(end[:, axis] - level) < 1e-9
        here &= (np.abs(low + high)[:, :2] < 2 * within).all(axis=1)
        if body is not None:
            here &= np.concatenate(self._body) == self._bodies.index(body)
        cell = np.flatnonzero(here)
        return np.stack([cell, np.full(len(cell), face)], axis=1).astype(np.int32)

    def vertical_edges(self, body, place):
        """Edges along z above one place of the plane, of the cells whose far corner is there.

        Args:
            body: name.
            place: x and y [-].

        Returns:
            (n, 2) int32 rows (cell, local edge).
        """
        here = (np.abs(self._ends()[1][:, :2] - place) < 1e-9).all(axis=1)
        cell = np.flatnonzero(here & (np.concatenate(self._body) == self._bodies.index(body)))
        edge = np.flatnonzero((hexahedron.EDGE_CORNERS == [3, 7]).all(axis=1))[0]
        return np.stack([cell, np.full(len(cell), edge)], axis=1).astype(np.int32)

    def mesh(self, surfaces, curves=None, place=None):
        """The root mesh.

        Args:
            surfaces, curves: name -> rows, as in RootMesh.
            place: function of a body's name and its (n, 3) float64 points [-] that says where they are [m].

        Returns:
            RootMesh.
        """
        points = [place(name, x) for name, x in zip(self._bodies, self._points)] if place else self._points
        return RootMesh(
            np.concatenate(points),
            np.concatenate(self._cells),
            tuple(self._bodies),
            np.concatenate(self._body),
            surfaces,
            curves=curves or {},
        )

    def _ends(self):
        """Low and high corners of all cells: two (n, 3) float64."""
        points, cells = np.concatenate(self._points), np.concatenate(self._cells)
        return points[cells[:, 0]], points[cells[:, -1]]
