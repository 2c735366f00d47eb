"""Stiffness matrices of curved cells, many at a time.

With the gradients g of the functions and the elastic moduli C, constant in a cell,

    K_(ai)(bj) = C_ikjl M_(ak)(bl),    M_(ak)(bl) = int g_ak g_bl.

M is a product of matrices and holds all integrals.  A second product applies the law.  An integrand of both, as FFCx
compiles it, takes some six times the operations.
"""

import numpy as np
from basix import CellType

from fx_contact.fem.leaf_mesh import LeafMesh, basix_order
from fx_contact.geometry import hexahedron
from fx_contact.items.materials import TENSOR
from fx_contact.parallel import compat
from fx_contact.parallel.arrays import FloatArray, IntArray


class CellStiffness:
    """Stiffness matrices of displacements of degree p by the Gauss rule of (p+1)^3 points.

    Local.

    Args:
        moduli: (materials, 6, 6), as of `Material.stiffness` [Pa].
        material: (ncells,), index of that of each local cell.
    """

    def __init__(self, leaf_mesh: LeafMesh, degree: int, moduli: FloatArray, material: IntArray) -> None:
        rule, weights = np.polynomial.legendre.leggauss(degree + 1)
        points = (rule + 1) / 2
        self._weights = np.kron(weights, np.kron(weights, weights)) / 8
        self._slopes = _slopes(degree, points)
        to_basix = basix_order(CellType.hexahedron, leaf_mesh.order)
        self._of_map = _slopes(leaf_mesh.order, points)[:, :, to_basix]
        self._mesh, self._material = leaf_mesh.mesh, material
        law = moduli[:, np.array(TENSOR)][:, :, :, np.array(TENSOR)]  # C_ikjl
        self._law = law.transpose(0, 2, 4, 1, 3).reshape(len(law), 9, 9)  # (k, l) to (i, j)

    def matrices(self, cells: IntArray) -> FloatArray:
        """K of local cells (n,): (n, k, k, 3, 3), nodes in tensor order [N/m]."""
        gradients = self._gradients(cells)
        n, points, _, k = gradients.shape
        rows = gradients.reshape(n, points, 3 * k)
        products = (rows.swapaxes(1, 2) @ rows).reshape(n, 3, k, 3, k).transpose(0, 2, 4, 1, 3).reshape(n, k * k, 9)
        return (products @ self._law[self._material[cells]]).reshape(n, k, k, 3, 3)

    def _gradients(self, cells: IntArray) -> FloatArray:
        """Gradients of the functions (n, points, 3, k) times the root of the weights [m^(1/2)]."""
        nodes = self._mesh.geometry.x[compat.geometry_nodes(self._mesh)[cells]]
        x, y, z = (axis @ nodes for axis in self._of_map)  # tangents of the map, (n, points, 3)
        dual = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=3)
        volume = np.einsum("nqi,nqi->nq", x, dual[..., 0])
        # The dual vectors are the gradients of the reference coordinates times the volume, whose sign cancels in K.
        dual *= np.sqrt(self._weights / np.abs(volume))[..., None, None]
        return dual @ self._slopes.swapaxes(0, 1)


def _slopes(order: int, points: FloatArray) -> FloatArray:
    """Derivatives of Lagrange functions along each axis at the tensor product of points: (3, points^3, (p+1)^3)."""
    value, slope = hexahedron.lagrange(order, points), hexahedron.lagrange_derivative(order, points)
    along = np.where(np.eye(3, dtype=bool)[:, :, None, None], slope, value)
    return np.array([np.kron(z, np.kron(y, x)) for x, y, z in along])
