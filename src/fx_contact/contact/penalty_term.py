"""The penalty term B^T k B: as entries of a matrix, and as an operator beside it."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc
from scipy.sparse import bsr_matrix

from fx_contact.contact.jump import Jump
from fx_contact.linalg.linear_solver import LinearSolver
from fx_contact.linalg.matrix import add_blocks
from fx_contact.linalg.operator import Equations, Operator, Projector, Sum
from fx_contact.linalg.p_multigrid import CoarseLevel
from fx_contact.parallel.arrays import BoolArray, FloatArray
from fx_contact.parallel.mpi import any_true


class PenaltyTerm(Operator):
    """B^T k B, with the forces B^T k (B u - D), for k (n,) of the rows, of any sign [N/m].

    Collective on the prolongation's comm.
    """

    def __init__(self, jump: Jump, stiffness: FloatArray) -> None:
        self.jump, self.stiffness = jump, stiffness

    def of(self, rows: BoolArray | FloatArray) -> PenaltyTerm:
        """The term with k times factors (n,).  Local."""
        return PenaltyTerm(self.jump, rows * self.stiffness)

    def add_product(self, u: FloatArray, y: FloatArray) -> None:
        """As `Operator.add_product`."""
        self.jump.matrix.add_transposed(self.stiffness * self.jump.matrix.times(u), y)

    def add_force(self, u: FloatArray, y: FloatArray) -> None:
        """As `Operator.add_force`."""
        penetration = self.jump.matrix.times(u) - self.jump.gap
        self.jump.matrix.add_transposed(self.stiffness * penetration, y)

    def diagonal(self) -> FloatArray:
        """As `Operator.diagonal`."""
        return self.jump.matrix.squares(self.stiffness)

    def load(self) -> FloatArray:
        """B^T k D, (owned, 3) [N]."""
        return self.jump.transposed(self.stiffness * self.jump.gap)

    def forces(self, u: FloatArray) -> FloatArray:
        """k (B u - D) of a displacement (owned, 3) [m]: (n,), compression positive [N]."""
        return self.stiffness * self.jump.penetration(u)

    def add_to(self, mat: PETSc.Mat) -> None:
        """Add the term to a matrix in blocks of 3 that has its entries."""
        _add(mat, self.jump, self.stiffness != 0, self.stiffness)
        mat.assemble()


class MatrixPenalty:
    """The penalty term that a solver's matrix contains, of rows with the directions that they had then.

    Collective on the prolongation's comm.

    Args:
        coarse: level below the matrix, which gets the same term; None: there is none.
        stiffness: (n,), k that the matrix contains [N/m].
    """

    def __init__(self, solver: LinearSolver, coarse: CoarseLevel | None, jump: Jump, stiffness: FloatArray) -> None:
        self._solver, self._coarse, self._jump, self.stiffness = solver, coarse, jump, stiffness

    def replace(self, jump: Jump, stiffness: FloatArray) -> None:
        """Exchange the term in the matrix."""
        if jump.matrix is not self._jump.matrix:
            PenaltyTerm(self._jump, -self.stiffness).add_to(self._solver.matrix)
            self.stiffness = np.zeros_like(stiffness)
            if self._coarse is not None:
                self._coarse.set_penalty(self.stiffness)
                self._coarse.couple(jump.matrix.distributed())
        PenaltyTerm(jump, stiffness - self.stiffness).add_to(self._solver.matrix)
        if self._coarse is not None:
            self._coarse.set_penalty(stiffness)
        self._jump, self.stiffness = jump, stiffness

    def differs(self, jump: Jump, stiffness: FloatArray) -> bool:
        """True if the matrix contains another term than that of k (n,)."""
        return jump.matrix is not self._jump.matrix or any_true(jump.comm, self.stiffness != stiffness)

    def equations(self, jump: Jump, load: FloatArray, stiffness: FloatArray, projector: Projector) -> Equations:
        """Equations of K + B^T k B for k (n,), whose difference to the matrix is a term beside it."""
        if jump.matrix is not self._jump.matrix:
            former = PenaltyTerm(self._jump.with_gap(np.zeros_like(jump.gap)), -self.stiffness)
            return Equations(load, Sum([PenaltyTerm(jump, stiffness), former]), projector)
        difference = stiffness - self.stiffness
        term = PenaltyTerm(jump, difference) if any_true(jump.comm, difference != 0) else None
        return Equations(load + PenaltyTerm(jump, self.stiffness).load(), term, projector)


def reserve(mat: PETSc.Mat, jump: Jump) -> None:
    """Make the entries of a penalty term of all rows, with zeros.  Local."""
    _add(mat, jump, np.ones(len(jump.gap), dtype=bool), np.zeros_like(jump.gap))


def _add(mat: PETSc.Mat, jump: Jump, some: BoolArray, stiffness: FloatArray) -> None:
    """Add B^T k B of some rows, zeros too."""
    entries = jump.rows.entries
    which = some[entries.row]
    if not which.any():
        return
    row, values = (np.cumsum(some) - 1)[entries.row[which]], jump.values[which][:, None]
    node, column = np.unique(entries.node[which], return_inverse=True)
    indptr, shape = np.searchsorted(row, np.arange(some.sum() + 1)), (some.sum(), 3 * len(node))
    scaled = bsr_matrix((stiffness[some][row][:, None, None] * values, column, indptr), shape=shape)
    product = scaled.T @ bsr_matrix((values, column, indptr), shape=shape)
    number = jump.rows.prolongation.index_map.local_to_global(node.astype(np.int32))
    add_blocks(mat, product, number.astype(np.int32))
