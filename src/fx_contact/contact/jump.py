"""The jump across the contact, B u, and its transpose."""

from copy import copy
from dataclasses import replace

import numpy as np
from dolfinx.la import InsertMode, vector
from mpi4py import MPI
from scipy.sparse import csr_matrix

from fx_contact.linalg.matrix import distributed
from fx_contact.linalg.operator import Array


class Products:
    """Products with a matrix of rows and with its transpose.

    Collective on the prolongation's comm.  They touch the unknowns of the rows alone, and need no message where every
    rank owns those of its rows.

    Args:
        rows: ConstraintRows.
        blocks: Blocks, as theirs but for the values.
    """

    def __init__(self, rows, blocks):
        self._prolongation = rows.prolongation
        node, place = np.unique(blocks.node, return_inverse=True)
        self._dofs = (3 * node[:, None] + np.arange(3)).ravel()
        columns, indptr = 3 * place[:, None] + np.arange(3), 3 * np.searchsorted(blocks.row, np.arange(len(rows) + 1))
        entries = blocks.values.ravel(), columns.ravel(), indptr
        self._matrix = csr_matrix(entries, shape=(len(rows), len(self._dofs)))
        self._transposed = self._matrix.T.tocsr()
        away = bool((node >= self._prolongation.owned).any())
        self._local = not self._prolongation.comm.allreduce(away, op=MPI.LOR)

    def distributed(self):
        """The matrix as one of PETSc's, rows by unknowns: PETSc AIJ.  Collective."""
        imap = self._prolongation.index_map
        width = 3 * (imap.size_local + imap.num_ghosts)
        whole = csr_matrix(
            (self._matrix.data, self._dofs[self._matrix.indices], self._matrix.indptr), (self._matrix.shape[0], width)
        )
        return distributed(self._prolongation.comm, whole, imap)

    def times(self, u):
        """The product with a displacement.

        Collective.

        Args:
            u: (owned, 3) float64 [m].

        Returns:
            (n,) float64 [m], of this rank's rows.
        """
        u = u if self._local else self._prolongation.ghosted(u)
        return self._matrix @ u.reshape(-1)[self._dofs]

    def add_transposed(self, values, y):
        """Add the product of the transpose with values of the rows to y.

        Collective.

        Args:
            values: (n,) float64, of this rank's rows [N].
            y: (owned, 3) float64 [N], contiguous; changed in place.
        """
        self._add(self._transposed @ values, y)

    def squares(self, weights: Array) -> Array:
        """The diagonal of B^T k B, (owned, 3), for weights k of the rows, (n,).  Collective."""
        result = np.zeros((self._prolongation.owned, 3))
        self._add(self._transposed.power(2) @ weights, result)
        return result

    def _add(self, values: Array, y: Array) -> None:
        """Add values at the unknowns of the rows to y."""
        if self._local:
            y.reshape(-1)[self._dofs] += values
            return
        result = vector(self._prolongation.index_map, 3)
        result.array[self._dofs] = values
        result.scatter_reverse(InsertMode.add)
        y += result.array[: y.size].reshape(-1, 3)


class Jump:
    """B on what conditions leave free, and D less what prescribed components contribute.

    Collective on the prolongation's comm.

    Args:
        rows: ConstraintRows.
        supports: Supports at the owned conforming nodes.

    Attributes:
        rows: as given.
        blocks: Blocks of B, 0 in held directions.
        matrix: Products with these.
        gap: (n,) float64 [m].
        movable: (n,) bool, where conditions leave the jump free.
    """

    #: Entries up to this one are the rounding of unit normals along an axis.
    _ROUNDING = 1e-8

    def __init__(self, rows, supports):
        self.rows, blocks = rows, rows.blocks
        values = supports.ghosted(rows.prolongation).free_part(blocks.values, blocks.node)
        values = np.where(np.abs(values) > self._ROUNDING, values, 0.0)
        self.blocks = replace(blocks, values=values)
        self.matrix = Products(rows, self.blocks)
        self.movable = blocks.sums(values.any(axis=1), len(rows)) > 0
        self.gap, self._whole_gap = rows.gap - rows.jump(supports.values), rows.gap

    def penetration(self, u):
        """B u - D of all components: (n,) float64 [m].  Collective.  Args: u: (owned, 3) float64 [m]."""
        return self.rows.jump(u) - self._whole_gap

    def with_gap(self, gap):
        """The same for another D: Jump.  Local.

        Args:
            gap: (n,) float64, less what prescribed components contribute [m].
        """
        other = copy(self)
        other.gap = other._whole_gap = gap
        return other
