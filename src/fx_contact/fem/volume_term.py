"""The volume term of nearly incompressible bodies beside the matrix, with pressures as unknowns.

K = A + D^T C D.  D u are the moments of div u with polynomials of degree p - 1, orthonormal in each cell; the matrix A
is too soft by C = lambda - lambda_A.  K u = f is solved as

    A u + D^T s = f,    D u - C^-1 s = 0,    s = C D u [Pa m^(3/2)],

whose condition is bounded for any lambda: at degree 2 the pair is stable (F. Brezzi, M. Fortin, Mixed and Hybrid Finite
Element Methods, 1991).  For waves inside a body, D A^-1 D^T = 1 / (2 mu + lambda_A).
"""

from collections.abc import Sequence

import numpy as np
from petsc4py import PETSc
from scipy.sparse import csr_matrix, diags, identity, kron, vstack

from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.supports import Supports
from fx_contact.linalg.matrix import add_blocks
from fx_contact.linalg.operator import PressureOperator
from fx_contact.parallel.arrays import FloatArray, IntArray


class VolumeTerm(PressureOperator):
    """D^T C D on this rank's cells, with the Schur complement S = C^-1 + (2 mu + lambda_A)^-1.

    Local.

    Args:
        moments: parts of the cells: their nodes of the space (n, k) and D of each cell (n, q, 3 k).
        missing: (m,), C of each row [Pa].
        wave: (m,), 2 mu + lambda_A [Pa].
    """

    def __init__(
        self,
        prolongation: Prolongation,
        moments: Sequence[tuple[IntArray, FloatArray]],
        missing: FloatArray,
        wave: FloatArray,
        supports: Supports,
    ) -> None:
        self._prolongation, self._supports, self.comm = prolongation, supports, prolongation.comm
        columns = 3 * len(prolongation.space)
        parts = [_rows(nodes, values, columns) for nodes, values in moments]
        constraint = kron(prolongation.matrix, identity(3), format="csr")
        self._matrix = vstack(parts, format="csr") @ constraint if parts else csr_matrix((0, constraint.shape[1]))
        self._transposed = self._matrix.T.tocsr()
        self.missing, self.schur = missing, 1 / (1 / missing + 1 / wave)

    def strains(self, u: FloatArray) -> FloatArray:
        """As `PressureOperator.strains`."""
        strains: FloatArray = self._matrix @ self._prolongation.ghosted(self._supports.tangential(u)).ravel()
        return strains

    def forces(self, pressure: FloatArray) -> FloatArray:
        """As `PressureOperator.forces`."""
        forces = self._prolongation.summed((self._transposed @ pressure).reshape(-1, 3))
        return self._supports.free_part(forces)

    def add_to(self, mat: PETSc.Mat) -> None:
        """As `PressureOperator.add_to`."""
        rows = self._matrix @ self._supports.ghosted(self._prolongation).projector()
        add_blocks(mat, (rows.T @ diags(self.missing) @ rows).tocsr(), self._prolongation.numbers)
        mat.assemble()

    def diagonal(self) -> FloatArray:
        """As `Operator.diagonal`; on oblique planes without their projector."""
        squares = self._prolongation.summed((self._transposed.power(2) @ self.missing).reshape(-1, 3))
        return np.where(self._supports.free, squares, 0.0)


def _rows(nodes: IntArray, values: FloatArray, columns: int) -> csr_matrix:
    """Rows of cells as a sparse matrix on the components of all nodes."""
    count, rows, width = values.shape
    where = np.repeat((3 * nodes[:, :, None] + np.arange(3)).reshape(count, 1, width), rows, axis=1)
    start = np.arange(0, values.size + 1, width)
    return csr_matrix((values.ravel(), where.ravel(), start), shape=(count * rows, columns))
