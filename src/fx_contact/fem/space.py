"""Where the unknowns sit: the nodes of a degree on a forest.

The nodes of degree p are the lattice points i/p, 0 <= i <= p along each axis of a leaf, in tensor order, x fastest.
They are named by their lattice keys, so that leaves and ranks that share a node agree on its name without a message.
At degree 1 they are the vertices of the leaves.
"""

from functools import cached_property
from numbers import Integral

import numpy as np

from fx_contact.forest.lattice_points import LatticePoints
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import shown
from fx_contact.problem import hexahedron
from fx_contact.problem.lattice import SIDE, leaf_side

#: Degrees of the displacements.
DEGREES = (1, 2)
#: Gauss points and weights on [0, 1] by degree, p + 1 of them, right to the last digit, which NumPy's are not.
_GAUSS = {
    1: (0.5 + np.array([-0.5, 0.5]) / np.sqrt(3), np.array([0.5, 0.5])),
    2: (0.5 + np.array([-0.5, 0.0, 0.5]) * np.sqrt(0.6), np.array([5.0, 8.0, 5.0]) / 18),
}


class Space:
    """The nodes of degree p of this rank's leaves.

    Collective on forest.comm.

    Args:
        forest: Forest.
        degree: p, 1 or 2.

    Attributes:
        forest, degree: as given.
        keys: (m,) int64, lattice keys of the nodes, in the order in which the leaves touch them first.
        cells: (n, (p+1)^3) int32, position in `keys` of the nodes of each leaf.
        example: (m, 2) int64, a leaf and the local node there at each node.
        directory: Directory of the keys.
        face_nodes: (6, (p+1)^2) int64, local nodes of each face of a leaf, first tangent fastest.
        edge_nodes: (12, p+1) int64, local nodes of each edge, from its low end.

    Raises:
        SceneError: another degree.
    """

    def __init__(self, forest, degree):
        if not isinstance(degree, Integral) or isinstance(degree, bool) or degree not in DEGREES:
            raise SceneError(
                f"a Space has degree 1 or 2, got {shown(degree)}: nodes are points of the integer lattice, on which a "
                "leaf can be halved, but not cut in three, nor in four on the finest level"
            )
        self.forest, self.degree = forest, degree
        self._nodes = forest.vertices if degree == 1 else LatticePoints(forest, self.points)
        self.keys, self.cells = self._nodes.keys, self._nodes.cells
        self.example, self.directory = self._nodes.example, self._nodes.directory
        self.face_nodes = hexahedron.face_nodes(degree)
        self.edge_nodes = hexahedron.edge_nodes(degree)

    def __len__(self):
        return len(self.keys)

    @cached_property
    def points(self):
        """(n, (p+1)^3, 3) int32, lattice coordinates of the nodes of each leaf."""
        forest = self.forest
        if self.degree == 1:
            return forest.corners
        side = leaf_side(forest.level)
        steps = hexahedron.grid_points(self.degree).astype(np.int32)
        return forest.anchor[:, None] + side[:, None, None] * steps // self.degree

    def find(self, keys):
        """Positions of keys among this rank's nodes, -1 where they are not.  Local.

        Args:
            keys: (...) int64.

        Returns:
            (...) int64.
        """
        return self._nodes.find(keys)

    def positions(self, nodes=slice(None)):
        """Where nodes are, on the curved geometry.

        Local.

        Args:
            nodes: (k,) int or bool, which nodes; default all.

        Returns:
            (k, 3) float64 [m].
        """
        leaf, local = self.example[nodes].T
        return self.forest.evaluate(self.forest.cell[leaf], self.points[leaf, local])

    def on_faces(self, leaf, face):
        """Nodes of faces of this rank's leaves.

        Local.

        Args:
            leaf, face: (k,) int, leaves and their local faces.

        Returns:
            (k, (p+1)^2) int32, first tangent fastest.
        """
        return self.cells[leaf[:, None], self.face_nodes[face]]

    def functions_at(self, cell, coordinates):
        """The shape functions at a point of a root cell.

        Local.

        Args:
            cell: root cell.
            coordinates: (3,) float64, reference coordinates of the point there, in [0, 1].

        Returns:
            (k,) int32 nodes and (k,) float64 values, k = (p+1)^3 on the one rank that has the point's leaf, else 0;
            of several leaves that have it, the highest along each axis.
        """
        forest, place = self.forest, SIDE * coordinates
        inside = np.minimum(np.floor(place), SIDE - 1) - forest.anchor
        side = leaf_side(forest.level)
        here = (forest.cell == cell) & ((0 <= inside) & (inside < side[:, None])).all(axis=1)
        at = (place - forest.anchor[here]) / side[here, None]
        x, y, z = (hexahedron.lagrange(self.degree, at[:, axis]) for axis in range(3))
        return self.cells[here].ravel(), np.einsum("nk,nj,ni->nkji", z, y, x).ravel()

    def facing(self, leaf, face):
        """Keys of the points that face the nodes of paired faces of this rank's leaves.

        Local.

        Args:
            leaf, face: (k,) int, leaves and their local faces, all on contact surfaces.

        Returns:
            (k, (p+1)^2) int64, in the order of `on_faces`.
        """
        forest = self.forest
        points = self.points[leaf[:, None], self.face_nodes[face]]
        cell, _, opposite = forest.pairing.opposite(forest.cell[leaf], face, points)
        return forest.lattice.keys(cell, opposite)

    @cached_property
    def facet_rule(self):
        """A Gauss rule on a facet, exact for products of its shape functions with the Jacobian of affine facets.

        Returns:
            (g,) float64 weights on the unit square, and the functions of the (p+1)^2 facet nodes at the g points:
            (g, (p+1)^2) float64 values, derivatives along the first tangent, and along the second.
        """
        x, w = _GAUSS[self.degree]
        value, slope = hexahedron.lagrange(self.degree, x), hexahedron.lagrange_derivative(self.degree, x)
        return np.kron(w, w), np.kron(value, value), np.kron(value, slope), np.kron(slope, value)


def child_error(degree):
    """xi_T^2 of a child over that of its parent where the solution is smooth, h^(2p+3) of p = degree [-].  Local."""
    return 2.0 ** -(2 * degree + 3)
