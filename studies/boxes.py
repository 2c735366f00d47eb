"""Bodies made of box cells, whose facets are found by their place: root meshes of studies and tests."""

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from fx_contact.geometry import hexahedron
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.geometry.solids import block

#: Local faces of a box cell by where they look.
DOWN, FRONT, LEFT, RIGHT, BACK, UP = range(6)


class Boxes:
    """Boxes of equal cells, each a body; facets and edges are found by their place in the boxes, before they are bent.

    Local.

    Args:
        order: of the cell maps.
    """

    def __init__(self, order: int) -> None:
        self._order = order
        self._points: list[npt.NDArray[np.float64]] = []
        self._cells: list[npt.NDArray[np.integer]] = []
        self._body: list[npt.NDArray[np.int32]] = []
        self._bodies: list[str] = []
        self._count = 0

    def add(self, name: str, low: Sequence[float], high: Sequence[float], counts: Sequence[int]) -> None:
        """Add a body.

        Args:
            name: of the body.
            low, high: its corners (3,) [-].
            counts: cells along x, y, z.
        """
        shape = block(low, high, counts, self._order)
        self._cells.append(self._count + shape.cells)
        self._points.append(shape.points)
        self._body.append(np.full(len(shape.cells), len(self._bodies), dtype=np.int32))
        self._bodies.append(name)
        self._count += len(shape.points)

    def facets(
        self, face: int, level: float, body: str | None = None, within: float = np.inf
    ) -> npt.NDArray[np.int32]:
        """Faces of cells that look one way and lie in a plane.

        Args:
            face: `DOWN`, `UP`, ...
            level: of the plane along its normal [-].
            body: name of the only body to look at, or None.
            within: half width of the square about the z axis that the facets' centres lie in [-].

        Returns:
            (n, 2) rows (cell, local face).
        """
        low, high = self._ends()
        axis, end = hexahedron.FACE_AXIS[face], (low, high)[hexahedron.FACE_SIDE[face]]
        here = np.abs(end[:, axis] - level) < 1e-9
        here &= (np.abs(low + high)[:, :2] < 2 * within).all(axis=1)
        if body is not None:
            here &= np.concatenate(self._body) == self._bodies.index(body)
        cell = np.flatnonzero(here)
        return np.stack([cell, np.full(len(cell), face)], axis=1).astype(np.int32)

    def mesh(
        self,
        surfaces: dict[str, npt.NDArray[np.int32]],
        curves: dict[str, npt.NDArray[np.int32]] | None = None,
        place: Callable[[str, npt.NDArray[np.float64]], npt.NDArray[np.float64]] | None = None,
    ) -> RootMesh:
        """The root mesh.

        Args:
            surfaces, curves: rows by name, as in RootMesh.
            place: a body's name and its (n, 3) points [-] -> their positions [m]; None: as they are.
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

    def _ends(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Low and high corners (n, 3) of all cells."""
        points, cells = np.concatenate(self._points), np.concatenate(self._cells)
        return points[cells[:, 0]], points[cells[:, -1]]
