"""Nodes of degree p of a forest: the lattice points i/p along each axis of a leaf, 0 <= i <= p, x fastest.

Lattice keys identify nodes, the same on all leaves and ranks without communication.  At degree 1 the nodes are the
vertices of the leaves.
"""

from functools import cached_property

import numpy as np

from fx_contact.forest.forest import Forest
from fx_contact.geometry import hexahedron
from fx_contact.geometry.lattice import SIDE, leaf_side
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int32Array, Int64Array, IntArray
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import shown

#: Degrees of the displacements.
DEGREES = (1, 2)
#: p + 1 Gauss points and weights on [0, 1] by degree p, to the last digit, unlike NumPy's.
_GAUSS: dict[int, tuple[FloatArray, FloatArray]] = {
    1: (0.5 + np.array([-0.5, 0.5]) / np.sqrt(3), np.array([0.5, 0.5])),
    2: (0.5 + np.array([-0.5, 0.0, 0.5]) * np.sqrt(0.6), np.array([5.0, 8.0, 5.0]) / 18),
}


class Space:
    """The nodes of degree p = 1 or 2 of this rank's leaves.

    Collective on forest.comm.  Raises SceneError for another degree.

    Attributes:
        keys: (m,), lattice keys of the nodes, in the order of their first leaves; there is a `directory` of them.
        cells: (n, (p+1)^3), position in `keys` of the nodes of each leaf.
        example: (m, 2), a leaf of each node and its local number there.
        face_nodes: (6, (p+1)^2), local nodes of each face of a leaf, first tangent fastest.
        edge_nodes: (12, p+1), local nodes of each edge, from its low end.
    """

    def __init__(self, forest: Forest, degree: int) -> None:
        if not isinstance(degree, (int, np.integer)) or isinstance(degree, bool) or degree not in DEGREES:
            raise SceneError(
                f"a Space has degree 1 or 2, got {shown(degree)}: nodes are points of the integer lattice, on which a "
                "leaf can be halved, but not cut in three, nor in four on the finest level"
            )
        self.forest, self.degree = forest, int(degree)
        self._nodes = forest.vertices if degree == 1 else forest.lattice_points(self.points)
        self.keys, self.cells = self._nodes.keys, self._nodes.cells
        self.example, self.directory = self._nodes.example, self._nodes.directory
        self.face_nodes = hexahedron.face_nodes(self.degree)
        self.edge_nodes = hexahedron.edge_nodes(self.degree)

    def __len__(self) -> int:
        return len(self.keys)

    @cached_property
    def points(self) -> Int32Array:
        """(n, (p+1)^3, 3), lattice coordinates of the nodes of each leaf."""
        forest = self.forest
        if self.degree == 1:
            return forest.corners
        side = leaf_side(forest.level)
        steps = hexahedron.grid_points(self.degree).astype(np.int32)
        return forest.anchor[:, None] + side[:, None, None] * steps // self.degree

    def find(self, keys: Int64Array) -> Int64Array:
        """Positions (...) of keys (...) among this rank's nodes, -1 for other keys.  Local."""
        return self._nodes.find(keys)

    def positions(self, nodes: IntArray | BoolArray | slice = slice(None)) -> FloatArray:
        """Positions (k, 3) [m] of nodes on the curved geometry, by default of all.  Local."""
        leaf, local = self.example[nodes].T
        return self.forest.evaluate(self.forest.cell[leaf], self.points[leaf, local])

    def on_faces(self, leaf: IntArray, face: IntArray) -> Int32Array:
        """Nodes (k, (p+1)^2) of local faces (k,) of leaves (k,), first tangent fastest.  Local."""
        return self.cells[leaf[:, None], self.face_nodes[face]]

    def functions_at(self, cell: int, coordinates: FloatArray) -> tuple[Int32Array, FloatArray]:
        """Nodes (k,) and values (k,) of shape functions at a point (3,) of a root cell, in coordinates in [0, 1].

        Local.  k = (p+1)^3 on the one rank that has the leaf with the point, else 0.  Of several leaves with the
        point the highest along each axis counts.
        """
        forest, place = self.forest, SIDE * coordinates
        inside = np.minimum(np.floor(place), SIDE - 1) - forest.anchor
        side = leaf_side(forest.level)
        here = (forest.cell == cell) & ((0 <= inside) & (inside < side[:, None])).all(axis=1)
        at = (place - forest.anchor[here]) / side[here, None]
        x, y, z = (hexahedron.lagrange(self.degree, at[:, axis]) for axis in range(3))
        return self.cells[here].ravel(), np.einsum("nk,nj,ni->nkji", z, y, x).ravel()

    def facing(self, leaf: IntArray, face: IntArray) -> Int64Array:
        """Keys (k, (p+1)^2) of the points that face the nodes of paired faces (k,), ordered as `on_faces`.  Local."""
        forest = self.forest
        points = self.points[leaf[:, None], self.face_nodes[face]]
        cell, _, opposite = forest.pairing.opposite(forest.cell[leaf], face, points)
        return forest.lattice.keys(cell, opposite)

    @cached_property
    def facet_rule(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Gauss rule on a facet, exact for products of its shape functions with the Jacobian of affine facets.

        Weights (g,) on the unit square, and at the points the shape functions and their derivatives along the first and
        the second tangent, (g, (p+1)^2).
        """
        x, w = _GAUSS[self.degree]
        value, slope = hexahedron.lagrange(self.degree, x), hexahedron.lagrange_derivative(self.degree, x)
        pairs = (w, w), (value, value), (value, slope), (slope, value)
        weights, values, first, second = (np.asarray(np.kron(*pair), dtype=np.float64) for pair in pairs)
        return weights, values, first, second


def child_error(degree: int) -> float:
    """xi_T^2 of a child over that of its parent where the solution is smooth, h^(2p+3) of p = degree [-].  Local."""
    return 2.0 ** -(2 * degree + 3)
