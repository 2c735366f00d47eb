"""The volume strains of nearly incompressible bodies beside the matrix, with pressures of their own.

K = A + D^T C D.  D u are the moments of div u with polynomials of degree p - 1, orthonormal in each cell.  The matrix
A is too soft by C = lambda - lambda_A.  K u = f is solved as

    A u + D^T s = f,    D u - C^-1 s = 0,    s = C D u [Pa m^(3/2)],

whose condition is bounded for any lambda: at degree 2 the pair is stable (F. Brezzi, M. Fortin, Mixed and Hybrid Finite
Element Methods, 1991).  For waves inside a body, D A^-1 D^T = 1 / (2 mu + lambda_A).
"""

import numpy as np
from scipy.sparse import csr_matrix, diags, identity, kron, vstack

from fx_contact.linalg.matrix import add_blocks


class VolumeTerm:
    """D and C on this rank's cells.

    Local.

    Args:
        prolongation: Prolongation.
        moments: list of parts of the cells: (n,) int64 nodes of the space (n, k) and D of each cell (n, q, 3 k).
        missing: (m,) float64, C of each row [Pa].
        wave: (m,) float64, 2 mu + lambda_A [Pa].
        supports: Supports at the owned conforming nodes.

    Attributes:
        comm: MPI communicator.
        missing: as given.
        schur: (m,) float64, S^-1 of the Schur complement's approximation S = C^-1 + (2 mu + lambda_A)^-1 [Pa].
    """

    def __init__(self, prolongation, moments, missing, wave, supports):
        self._prolongation, self._supports, self.comm = prolongation, supports, prolongation.comm
        columns = 3 * len(prolongation.space)
        parts = [_rows(nodes, values, columns) for nodes, values in moments]
        constraint = kron(prolongation.matrix, identity(3), format="csr")
        self._matrix = vstack(parts, format="csr") @ constraint if parts else csr_matrix((0, constraint.shape[1]))
        self._transposed = self._matrix.T.tocsr()
        self.missing, self.schur = missing, 1 / (1 / missing + 1 / wave)

    def __len__(self):
        return len(self.missing)

    def strains(self, u):
        """D u.

        Collective.

        Args:
            u: (owned, 3) float64 [m].

        Returns:
            (m,) float64 [m^(3/2)].
        """
        return self._matrix @ self._prolongation.ghosted(self._supports.along_planes(u)).ravel()

    def forces(self, pressure):
        """D^T s, 0 in held directions.

        Collective.

        Args:
            pressure: (m,) float64 [Pa m^(3/2)].

        Returns:
            (owned, 3) float64 [N].
        """
        return self._supports.free_part(self._prolongation.summed((self._transposed @ pressure).reshape(-1, 3)))

    def forces_of_held(self, u):
        """D^T C D of what conditions prescribe of a displacement.

        Collective.

        Args:
            u: (owned, 3) float64 [m].

        Returns:
            (owned, 3) float64, 0 in held directions [N].
        """
        return self.forces(self.missing * self.strains(u - self._supports.free_part(u)))

    def add_to(self, mat):
        """Add D^T C D to a matrix that has the entries of K, but for rows and columns of held directions.

        Collective.

        Args:
            mat: PETSc Mat in blocks of 3.
        """
        imap, rows = (
            self._prolongation.index_map,
            self._matrix @ self._supports.ghosted(self._prolongation).projector(),
        )
        number = imap.local_to_global(np.arange(imap.size_local + imap.num_ghosts, dtype=np.int32)).astype(np.int32)
        add_blocks(mat, (rows.T @ diags(self.missing) @ rows).tocsr(), number)
        mat.assemble()

    def diagonal(self):
        """The diagonal of D^T C D, on oblique planes without their projector: (owned, 3) float64 [N/m].  Collective."""
        squares = self._transposed.power(2) @ self.missing
        return self._supports.free * self._prolongation.summed(squares.reshape(-1, 3))


def _rows(nodes, values, columns):
    """Rows of cells as a sparse matrix on the components of all nodes."""
    count, rows, width = values.shape
    where = np.repeat((3 * nodes[:, :, None] + np.arange(3)).reshape(count, 1, width), rows, axis=1)
    start = np.arange(0, values.size + 1, width)
    return csr_matrix((values.ravel(), where.ravel(), start), shape=(count * rows, columns))
