"""The Gram matrix B W^-1 B^T of closed rows."""

from __future__ import annotations

from copy import copy

import numpy as np
from mpi4py import MPI
from scipy.sparse.linalg import SuperLU, splu

from fx_contact.contact.jump import Products
from fx_contact.parallel.arrays import BoolArray, FloatArray
from fx_contact.parallel.errors import SolveError
from fx_contact.parallel.mpi import any_true


class Gram:
    """G = B W^-1 B^T on closed rows, diagonal if no component of a node is in two rows.

    Else conjugate residuals, preconditioned by the diagonal, and after many iterations by factors of each rank's block.

    Collective on the prolongation's comm.

    Args:
        matrix, weighted: B and B W^-1.
        diagonal: (n,), of G [m/N].
        share: (n,), of each row among those of its node, by which equal rows share their force [-]; None on all ranks:
            G is diagonal.

    Attributes:
        closed: (n,), at first none.
    """

    #: Most iterations, and relative residual.  Node pairs take as many iterations as a node has pairs, rows of surfaces
    #: meshed apart 2 to 30 (`test_mortar_rows`, `test_crosspoints`).
    _ITERATIONS, _RESIDUAL = 200, 1e-15
    #: Rayleigh quotients relative to the diagonal up to which they are the rounding of 0, and pivots.
    _SINGULAR, _DEPENDENT = 1e-14, 1e-8
    #: Iterations before factors, which cost as many: 24 to 75 with 150 to 8,000 rows (`studies.cost.chains --gram`).
    _PATIENCE = 50

    def __init__(self, matrix: Products, weighted: Products, diagonal: FloatArray, share: FloatArray | None) -> None:
        self._comm, self._matrix, self._weighted = matrix.comm, matrix, weighted
        self._diagonal, self._share = diagonal, share
        self._close(np.zeros(len(diagonal), dtype=bool))

    def on(self, closed: BoolArray) -> Gram:
        """The Gram matrix of closed rows (n,); itself if they are the present ones."""
        if not any_true(self._comm, self.closed != closed):
            return self
        other = copy(self)
        other._close(closed)
        return other

    def _close(self, closed: BoolArray) -> None:
        self.closed, self._spent, self._exact = closed, 0.0, False
        self._inverse = np.divide(1.0, self._diagonal, out=np.zeros(len(closed)), where=closed)
        self._scale = self._inverse if self._share is None else self._inverse * self._share
        self._factors: SuperLU | None = None

    def solve(self, values: FloatArray) -> FloatArray:
        """G^-1 values (n,), 0 in open rows; equal rows share their part.

        Raises SolveError: it is not found in `_ITERATIONS` iterations.
        """
        if self._share is None:
            return self._inverse * values
        if self._spent >= self._PATIENCE:
            self._factorise()
        if self._exact:
            return self._preconditioned(values)
        solution, residual = np.zeros(len(values)), np.where(self.closed, values, 0.0)
        first, past, scaled = -1.0, np.inf, self._preconditioned(residual)
        direction, image = np.zeros_like(solution), np.zeros_like(solution)
        for _ in range(self._ITERATIONS):
            product = np.where(self.closed, self._matrix.times_transposed(self._weighted, scaled), 0.0)
            size, curvature = self._dots((residual, scaled), (scaled, product))
            first = size if first < 0 else first
            # Converged, or the residual is that of equal or contradicting rows.
            if size <= self._RESIDUAL**2 * first or curvature <= self._SINGULAR * size:
                return solution
            direction, image = scaled + curvature / past * direction, product + curvature / past * image
            conjugate = self._preconditioned(image)
            (length,) = self._dots((image, conjugate))
            step, past = curvature / length, curvature
            solution, residual = solution + step * direction, residual - step * image
            scaled = scaled - step * conjugate
            self._spent += 1
        raise SolveError(
            f"the projection onto closed contact has not converged in {self._ITERATIONS} iterations: rows of contact "
            "are almost dependent, as on surfaces of several contacts or ties that share an edge, or on facets of very "
            "different sizes"
        )

    def _preconditioned(self, values: FloatArray) -> FloatArray:
        if self._factors is None:
            return self._scale * values
        result: FloatArray = np.zeros(len(values))
        result[self.closed] = self._factors.solve(values[self.closed])
        return result

    def _factorise(self) -> None:
        """Factors of this rank's block, unless its rows are dependent; exact without nodes of other ranks."""
        self._spent, closed = -np.inf, self.closed
        if closed.any():
            block = self._matrix.gram(self._weighted, closed)
            try:
                factors = splu(
                    block, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
                )
                pivots = factors.U.diagonal()[factors.perm_c] * self._inverse[closed]
                self._factors = factors if pivots.min() > self._DEPENDENT else None
            except RuntimeError:  # it is exactly singular
                self._factors = None
        inexact = bool(closed.any()) and self._factors is None
        self._exact = self._matrix.is_local and not any_true(self._comm, np.array([inexact]))

    def _dots(self, *factors: tuple[FloatArray, FloatArray]) -> FloatArray:
        sums: FloatArray = np.array([a @ b for a, b in factors])
        self._comm.Allreduce(MPI.IN_PLACE, sums)
        return sums
