"""Coarse level of p-multigrid: matrix with the penalty term of contact, interpolation, blocks of the smoother."""

import numpy as np
from petsc4py import PETSc

from fx_contact.parallel.arrays import FloatArray, Int64Array
from fx_contact.parallel.exchange import Exchange


class CoarseLevel:
    """A coarse matrix K_c + (B I)^T k B I and the interpolation I from its unknowns.

    Collective.  K_c, to which the penalty term is added, and I are AIJ matrices.

    Args:
        blocks: (owned,), block of each fine node, from `coarse_level.strong_blocks`; None: a node is a block.
    """

    def __init__(self, matrix: PETSc.Mat, interpolation: PETSc.Mat, blocks: Int64Array | None = None) -> None:
        self.matrix, self.interpolation, self.blocks = matrix, interpolation, blocks
        self.matrix.setOption(PETSc.Mat.Option.SPD, True)
        self._rows: PETSc.Mat | None = None
        self._stiffness: FloatArray = np.zeros(0)

    def couple(self, rows: PETSc.Mat) -> None:
        """Make room for the penalty term of rows B, an AIJ matrix by fine unknowns, which is destroyed.

        In place of other rows, whose penalty is 0.
        """
        if self._rows is not None:
            self._rows.destroy()
        self._rows = rows.matMult(self.interpolation)
        rows.destroy()
        self._stiffness = np.zeros(self._rows.getLocalSize()[0])
        self._add(self._stiffness, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        self.matrix.setOption(PETSc.Mat.Option.SPD, True)  # the new pattern forgot it

    def set_penalty(self, stiffness: FloatArray) -> None:
        """Change the penalty term to (n,) k of this rank's rows [N/m]."""
        self._add(stiffness - self._stiffness, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        self._stiffness = stiffness

    def _add(self, stiffness: FloatArray, pattern: int) -> None:
        assert self._rows is not None
        scaled, scale = self._rows.copy(), self._rows.createVecLeft()
        scale.array[:] = stiffness
        scaled.diagonalScale(L=scale)
        penalty = self._rows.transposeMatMult(scaled)
        self.matrix.axpy(1.0, penalty, pattern)
        for thing in (scaled, scale, penalty):
            thing.destroy()

    def _objects(self) -> list[PETSc.Mat]:
        return [mat for mat in (self.matrix, self.interpolation, self._rows) if mat is not None]

    def destroy(self) -> None:
        """Free the matrices, for `PetscObjects`."""
        for mat in self._objects():
            mat.destroy()

    def incRef(self) -> None:  # noqa: N802, PETSc's name
        """Keep the matrices for good, for `PetscObjects`.  Local."""
        for mat in self._objects():
            mat.incRef()


def within_blocks(matrix: PETSc.Mat, blocks: Int64Array) -> PETSc.Mat:
    """The entries of a matrix that couple unknowns of one block of nodes: AIJ of the same layout.  Collective."""
    aij = matrix.convert(PETSc.Mat.Type.AIJ, PETSc.Mat())
    indptr, indices, values = aij.getValuesCSR()
    aij.destroy()
    of_unknowns = np.repeat(blocks, 3).astype(float)  # exact below 2^53
    of_columns = PETSc.Mat().createAIJ(
        matrix.getSizes(), csr=(indptr, indices, np.ones(len(values))), comm=matrix.comm
    )
    scale = PETSc.Vec().createWithArray(of_unknowns, comm=matrix.comm)
    of_columns.diagonalScale(R=scale)
    inside = of_columns.getValuesCSR()[2] == np.repeat(of_unknowns, np.diff(indptr))
    for thing in (of_columns, scale):
        thing.destroy()
    csr = np.append(0, np.cumsum(inside))[indptr].astype(PETSc.IntType), indices[inside], values[inside]
    return PETSc.Mat().createAIJ(matrix.getSizes(), bsize=3, csr=csr, comm=matrix.comm)


def solved_here(matrix: PETSc.Mat, blocks: Int64Array) -> PETSc.IS:
    """Global numbers of the unknowns in the blocks that this rank solves for.  Collective."""
    nodes = matrix.getOwnershipRange()[0] // 3 + np.arange(len(blocks))
    nodes = Exchange(matrix.comm.tompi4py(), blocks % matrix.comm.size).forward(nodes)
    return PETSc.IS().createBlock(3, np.sort(nodes).astype(PETSc.IntType), PETSc.COMM_SELF)
