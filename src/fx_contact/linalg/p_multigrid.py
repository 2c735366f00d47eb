"""The coarse level of p-multigrid: its matrix with the penalty term of contact, the interpolation from it, and the
blocks of nodes that the smoother above solves for at once.
"""

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from fx_contact.linalg.operator import Array
from fx_contact.parallel.exchange import Exchange


class CoarseLevel:
    """A coarse matrix K_c + (B I)^T k B I and the interpolation I from its unknowns.

    Collective.

    Args:
        matrix: AIJ matrix K_c, without penalty term; changed with that.
        interpolation: AIJ matrix I, fine unknowns by coarse ones.
        blocks: (n,) int64, block of each of this rank's fine nodes, as `flat_cells.strong_blocks` gives it; None: a
            node is a block.

    Attributes:
        matrix, interpolation, blocks: as given.
    """

    def __init__(
        self, matrix: PETSc.Mat, interpolation: PETSc.Mat, blocks: npt.NDArray[np.int64] | None = None
    ) -> None:
        self.matrix, self.interpolation, self.blocks = matrix, interpolation, blocks
        self._rows: PETSc.Mat | None = None
        self._stiffness: Array = np.zeros(0)

    def couple(self, rows: PETSc.Mat) -> None:
        """Make room for the penalty term of some rows; at first it is 0.

        Args:
            rows: AIJ matrix B, rows by fine unknowns; it is used up.
        """
        self._rows = rows.matMult(self.interpolation)
        rows.destroy()
        self._stiffness = np.zeros(self._rows.getLocalSize()[0])
        self._add(self._stiffness, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)

    def set_penalty(self, stiffness: Array) -> None:
        """Change the penalty term to (n,) k of this rank's rows [N/m]."""
        self._add(stiffness - self._stiffness, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        self._stiffness = stiffness

    def _add(self, stiffness: Array, pattern: int) -> None:
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
        """Free what PETSc holds; as `PetscObjects` calls it."""
        for mat in self._objects():
            mat.destroy()

    def incRef(self) -> None:  # noqa: N802, PETSc's name
        """Keep what PETSc holds for good; as `PetscObjects` calls it.  Local."""
        for mat in self._objects():
            mat.incRef()


def within_blocks(matrix: PETSc.Mat, blocks: npt.NDArray[np.int64]) -> PETSc.Mat:
    """The entries of a matrix that couple unknowns of one block.

    Collective.

    Args:
        matrix: BAIJ matrix of nodes, in blocks of 3 x 3.
        blocks: as those of `CoarseLevel`.

    Returns:
        AIJ matrix of the same layout.
    """
    aij = matrix.convert(PETSc.Mat.Type.AIJ, PETSc.Mat())
    indptr, indices, values = aij.getValuesCSR()
    aij.destroy()
    inside = np.repeat(blocks, 3 * np.diff(indptr)[::3]) == _of_nodes(matrix, blocks, indices // 3)
    csr = np.append(0, np.cumsum(inside))[indptr].astype(PETSc.IntType), indices[inside], values[inside]
    return PETSc.Mat().createAIJ(matrix.getSizes(), bsize=3, csr=csr, comm=matrix.comm)


def solved_here(matrix: PETSc.Mat, blocks: npt.NDArray[np.int64]) -> PETSc.IS:
    """Global numbers of the unknowns in the blocks that this rank solves for; arguments as of `within_blocks`.

    Collective.
    """
    nodes = matrix.getOwnershipRange()[0] // 3 + np.arange(len(blocks))
    nodes = Exchange(matrix.comm.tompi4py(), blocks % matrix.comm.size).forward(nodes)
    return PETSc.IS().createBlock(3, np.sort(nodes).astype(PETSc.IntType), PETSc.COMM_SELF)


def _of_nodes(
    matrix: PETSc.Mat, blocks: npt.NDArray[np.int64], nodes: npt.NDArray[np.integer]
) -> npt.NDArray[np.int64]:
    """The blocks of nodes of any ranks, given by global numbers."""
    first = matrix.getOwnershipRange()[0] // 3
    result = np.empty(len(nodes), dtype=np.int64)
    foreign = (nodes < first) | (nodes >= first + len(blocks))
    result[~foreign] = blocks[nodes[~foreign] - first]
    asked, back = np.unique(nodes[foreign], return_inverse=True)
    everywhere = PETSc.Vec().createWithArray(blocks.astype(float), comm=matrix.comm)  # exact below 2^53
    wanted, found = PETSc.IS().createGeneral(asked, PETSc.COMM_SELF), PETSc.Vec().createSeq(len(asked))
    scatter = PETSc.Scatter().create(everywhere, wanted, found, None)
    scatter.scatter(everywhere, found)
    result[foreign] = found.array[back]
    for thing in (everywhere, wanted, found, scatter):
        thing.destroy()
    return result
