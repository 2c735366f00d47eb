"""The jump across the contact, B u, and its transpose."""

from __future__ import annotations

from copy import copy

import numpy as np
from petsc4py import PETSc
from scipy.sparse import csc_matrix, csr_matrix

from fx_contact.contact.constraint_rows import ConstraintRows
from fx_contact.fem.supports import Supports
from fx_contact.linalg.matrix import distributed
from fx_contact.parallel.arrays import BoolArray, FloatArray
from fx_contact.parallel.mpi import any_true


class Products:
    """Products with a matrix that has values (b, 3) at the entries of rows, and with its transpose.

    Collective on the prolongation's comm.  They need no message where every rank owns the unknowns of its rows.

    Attributes:
        is_local: True if every rank owns the unknowns of its rows.
    """

    def __init__(self, rows: ConstraintRows, values: FloatArray) -> None:
        self._prolongation, self.comm = rows.prolongation, rows.prolongation.comm
        node, place = np.unique(rows.entries.node, return_inverse=True)
        self._dofs = (3 * node[:, None] + np.arange(3)).ravel()
        columns = 3 * place[:, None] + np.arange(3)
        indptr = 3 * np.searchsorted(rows.entries.row, np.arange(len(rows) + 1))
        self._matrix = csr_matrix((values.ravel(), columns.ravel(), indptr), shape=(len(rows), len(self._dofs)))
        self._transposed = self._matrix.T.tocsr()
        self.is_local = not any_true(self.comm, node >= self._prolongation.owned)

    def distributed(self) -> PETSc.Mat:
        """The AIJ matrix, rows by unknowns."""
        imap, matrix = self._prolongation.index_map, self._matrix
        entries = matrix.data, self._dofs[matrix.indices], matrix.indptr
        all_columns = csr_matrix(entries, (matrix.shape[0], 3 * (imap.size_local + imap.num_ghosts)))
        return distributed(self.comm, all_columns, imap)

    def times(self, u: FloatArray) -> FloatArray:
        """Product (n,) [m] with a displacement (owned, 3) [m]."""
        u = u if self.is_local else self._prolongation.ghosted(u)
        return self._matrix @ u.reshape(-1)[self._dofs]

    def add_transposed(self, values: FloatArray, y: FloatArray) -> None:
        """y (owned, 3) += B^T f for f (n,) [N]; y is contiguous."""
        self._add(self._transposed @ values, y)

    def times_transposed(self, other: Products, values: FloatArray) -> FloatArray:
        """Product (n,) with the transpose of another matrix of the same rows, times values (n,)."""
        if self.is_local:
            return np.asarray(self._matrix @ (other._transposed @ values))
        u: FloatArray = np.zeros((self._prolongation.owned, 3))
        other.add_transposed(values, u)
        return self.times(u)

    def gram(self, other: Products, some: BoolArray) -> csc_matrix:
        """The product with the transpose of another matrix on some of the rows (n,), without what is of other ranks."""
        return (self._matrix[some] @ other._transposed[:, some]).tocsc()

    def squares(self, weights: FloatArray) -> FloatArray:
        """The diagonal (owned, 3) of B^T k B, for weights k (n,)."""
        result: FloatArray = np.zeros((self._prolongation.owned, 3))
        self._add(self._transposed.power(2) @ weights, result)
        return result

    def _add(self, values: FloatArray, y: FloatArray) -> None:
        if self.is_local:
            y.reshape(-1)[self._dofs] += values
            return
        result = self._prolongation.zeros(3)
        result.reshape(-1)[self._dofs] = values
        y += self._prolongation.summed(result)


class Jump:
    """B in the free directions of supports at the owned conforming nodes, and D less the prescribed components.

    Collective on the prolongation's comm.

    Attributes:
        values: (b, 3), blocks of B at the entries of the rows, 0 in constrained directions.
        matrix: products with B.
        gap: (n,), D less B u of the prescribed components [m].
        movable: (n,), rows whose jump is free.
    """

    #: Values up to this part of their weight are the rounding of unit normals along an axis.
    _ROUNDING = 1e-8

    def __init__(self, rows: ConstraintRows, supports: Supports) -> None:
        self.rows, self.comm = rows, rows.prolongation.comm
        values = supports.ghosted(rows.prolongation).free_part(rows.values, rows.entries.node)
        self.values = np.where(np.abs(values) > self._ROUNDING * np.abs(rows.entries.weight)[:, None], values, 0.0)
        self.matrix = Products(rows, self.values)
        self.movable = rows.entries.sums(self.values.any(axis=1).astype(float), len(rows)) > 0
        self.gap, self._full_gap = rows.gap - rows.jump(supports.values), rows.gap

    def penetration(self, u: FloatArray) -> FloatArray:
        """B u - D (n,) [m] with all components of a displacement (owned, 3) [m]."""
        return self.rows.jump(u) - self._full_gap

    def transposed(self, force: FloatArray) -> FloatArray:
        """B^T f of forces (n,) [N] in the free directions: (owned, 3) [N]."""
        result: FloatArray = np.zeros((self.rows.prolongation.owned, 3))
        self.matrix.add_transposed(force, result)
        return result

    def shifted(self, shift: FloatArray) -> Jump:
        """Jump with gaps D + shift (n,) [m].  Local."""
        other = copy(self)
        other.gap, other._full_gap = self.gap + shift, self._full_gap + shift
        return other

    def with_gap(self, gap: FloatArray) -> Jump:
        """Jump with another gap D (n,) [m], and nothing prescribed.  Local."""
        other = copy(self)
        other.gap = other._full_gap = gap
        return other
