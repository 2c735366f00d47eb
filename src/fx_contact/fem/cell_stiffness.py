"""Stiffness matrices of curved cells, many at a time.

With the gradients g of the functions and the elastic moduli C, constant in a cell,

    K_(ai)(bj) = C_ikjl M_(ak)(bl),    M_(ak)(bl) = int g_ak g_bl.

M is a product of matrices and holds all integrals.  A second product applies the law.  An integrand of both, as FFCx
compiles it, takes some six times the operations.  Projected volume strains (`volume_projection`) add lambda D^T D.
"""

from collections.abc import Iterator
from itertools import product

import numpy as np
from basix import CellType

from fx_contact.fem.leaf_mesh import LeafMesh, basix_order
from fx_contact.geometry import hexahedron
from fx_contact.items.materials import TENSOR
from fx_contact.parallel import compat
from fx_contact.parallel.arrays import BoolArray, FloatArray, IntArray

#: Numbers that are made at once: 16 MB, three times as much while they are made, four times on hanging nodes.
_CHUNK = 1 << 21


def parts(cells: IntArray, numbers: int) -> Iterator[IntArray]:
    """Parts of cells (n,) with so many numbers each.  Local."""
    size = max(_CHUNK // numbers, 1)
    return (cells[start : start + size] for start in range(0, len(cells), size))


class CellStiffness:
    """Stiffness matrices of displacements of degree p by the Gauss rule of (p+1)^3 points.

    Local.

    Args:
        moduli: (materials, 6, 6), as of `Material.stiffness` [Pa].
        material: (ncells,), index of that of each local cell.
        volume: (ncells,), lambda of projected volume strains, 0 of other cells [Pa].

    Attributes:
        points: (p+1,), of the rule along an axis of [0, 1]^3.
        grid, weights: ((p+1)^3, 3) and ((p+1)^3,), of the rule.
        slopes: (3, (p+1)^3, (p+1)^3), derivatives of the functions along the axes at the points.
        powers: (q, 3), of the coordinates in the monomials of degree p - 1 or less.
    """

    def __init__(
        self, leaf_mesh: LeafMesh, degree: int, moduli: FloatArray, material: IntArray, volume: FloatArray
    ) -> None:
        rule, weights = np.polynomial.legendre.leggauss(degree + 1)
        self.points, self.weights = (rule + 1) / 2, np.kron(weights, np.kron(weights, weights)) / 8
        self.grid = np.stack(np.meshgrid(*3 * [self.points], indexing="ij")[::-1], axis=-1).reshape(-1, 3)
        self.slopes, self.degree = _slopes(degree, self.points), degree
        self.powers = np.array([each for each in product(range(degree), repeat=3) if sum(each) < degree])
        self.moduli, self.material, self.volume = moduli, material, volume
        to_basix = basix_order(CellType.hexahedron, leaf_mesh.order)
        self._of_map = _slopes(leaf_mesh.order, self.points)[:, :, to_basix]
        self._mesh = leaf_mesh.mesh
        law = moduli[:, np.array(TENSOR)][:, :, :, np.array(TENSOR)]  # C_ikjl
        self._law = law.transpose(0, 2, 4, 1, 3).reshape(len(law), 9, 9)  # (k, l) to (i, j)

    def matrices(self, cells: IntArray) -> FloatArray:
        """K of local cells (n,): (n, k, k, 3, 3), nodes in tensor order [N/m]."""
        metric = self.metric(cells)
        gradients = self._gradients(metric)
        n, points, _, k = gradients.shape
        rows = gradients.reshape(n, points, 3 * k)
        products = (rows.swapaxes(1, 2) @ rows).reshape(n, 3, k, 3, k).transpose(0, 2, 4, 1, 3).reshape(n, k * k, 9)
        result = (products @ self._law[self.material[cells]]).reshape(n, k, k, 3, 3)
        some = self.projected(cells)
        if some.any():
            d = self._moments(metric[some], gradients[some])
            of_volume = d.swapaxes(1, 2) @ (self.volume[cells[some], None, None] * d)
            result[some] += of_volume.reshape(-1, k, 3, k, 3).transpose(0, 1, 3, 2, 4)
        return result

    def projected(self, cells: IntArray) -> BoolArray:
        """(n,), True for cells whose volume strain is projected."""
        return np.asarray(self.volume[cells] > 0)

    def moments(self, cells: IntArray) -> FloatArray:
        """D of cells (n,): moments of div u with polynomials orthonormal in each cell, (n, q, 3 k) [m^(1/2)]."""
        metric = self.metric(cells)
        return self._moments(metric, self._gradients(metric))

    def _moments(self, metric: FloatArray, gradients: FloatArray) -> FloatArray:
        d = np.einsum("nqr,nqik->nrki", self.polynomials(metric), gradients, optimize=True)
        return d.reshape(*d.shape[:2], 3 * gradients.shape[3])

    def polynomials(self, metric: FloatArray) -> FloatArray:
        """Values (n, points, q) of such polynomials times (w |J|)^(1/2)."""
        values = np.prod(self.grid[:, None] ** self.powers, axis=2)
        return np.linalg.qr(np.sqrt(self._volumes(metric))[:, :, None] * values)[0]

    def volumes(self, cells: IntArray) -> FloatArray:
        """Weights of the points in cells (n,): (n, points) [m^3]."""
        some = [self._volumes(self.metric(part)) for part in parts(cells, 9 * len(self.weights))]
        return np.concatenate([np.zeros((0, len(self.weights))), *some])

    def _volumes(self, metric: FloatArray) -> FloatArray:
        return self.weights * np.linalg.det(metric) ** 2  # det J^(-T) |J|^(3/2) is |J|^(1/2)

    def metric(self, cells: IntArray) -> FloatArray:
        """J^(-T) |J|^(1/2) of cells (n,) at the points, but for the sign of |J|: (n, points, 3, 3) [m^(1/2)]."""
        nodes = self._mesh.geometry.x[compat.geometry_nodes(self._mesh)[cells]]
        x, y, z = (axis @ nodes for axis in self._of_map)  # tangents of the map, (n, points, 3)
        dual = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=3)
        dual /= np.sqrt(np.abs(np.einsum("nqi,nqi->nq", x, dual[..., 0])))[..., None, None]
        return dual

    def _gradients(self, metric: FloatArray) -> FloatArray:
        """Gradients of the functions times (w |J|)^(1/2), (n, points, 3, k) [m^(1/2)]."""
        return (metric * np.sqrt(self.weights)[:, None, None]) @ self.slopes.swapaxes(0, 1)


def _slopes(order: int, points: FloatArray) -> FloatArray:
    """Derivatives of Lagrange functions along each axis at the tensor product of points: (3, points^3, (p+1)^3)."""
    value, slope = hexahedron.lagrange(order, points), hexahedron.lagrange_derivative(order, points)
    along = np.where(np.eye(3, dtype=bool)[:, :, None, None], slope, value)
    return np.array([np.kron(z, np.kron(y, x)) for x, y, z in along])
