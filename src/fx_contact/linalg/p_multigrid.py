"""The coarse level of p-multigrid: its matrix, with the springs of closed contact, and the interpolation from it.

Beside it what the smoother above needs to know of the mesh: blocks of nodes to be solved for at once.
"""

import numpy as np
from petsc4py import PETSc
from scipy.sparse import coo_matrix, csr_matrix

from fx_contact.linalg.matrix import add_blocks


class CoarseLevel:
    """A coarse matrix K_c and the interpolation I from its unknowns; with springs K_c + (B I)^T k B I.

    Collective.

    Args:
        matrix: PETSc AIJ matrix K_c, without springs; changed when these do.
        interpolation: PETSc AIJ matrix I, fine unknowns by coarse ones.
        blocks: (n,) int, block of each of this rank's fine nodes for the smoother; None: a node is a block.

    Attributes:
        matrix, interpolation, blocks: as given.
    """

    def __init__(self, matrix, interpolation, blocks=None):
        self.matrix, self.interpolation, self.blocks = matrix, interpolation, blocks
        self._rows = self._stiffness = None

    def couple(self, rows):
        """Make room for springs across some rows; at first they are 0.  Collective.

        Args:
            rows: PETSc AIJ matrix B, rows by fine unknowns; it is used up.
        """
        self._rows = rows.matMult(self.interpolation)
        rows.destroy()
        self._stiffness = np.zeros(self._rows.getLocalSize()[0])
        self._add(self._stiffness, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)

    def stiffen(self, stiffness):
        """Change the springs.  Collective.

        Args:
            stiffness: (n,) float64, k of this rank's rows [N/m].
        """
        self._add(stiffness - self._stiffness, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        self._stiffness = stiffness

    def _add(self, stiffness, pattern):
        scaled, scale = self._rows.copy(), self._rows.createVecLeft()
        scale.array[:] = stiffness
        scaled.diagonalScale(L=scale)
        springs = self._rows.transposeMatMult(scaled)
        self.matrix.axpy(1.0, springs, pattern)
        for thing in (scaled, scale, springs):
            thing.destroy()

    def _things(self):
        return [thing for thing in (self.matrix, self.interpolation, self._rows) if thing is not None]

    def destroy(self):
        """Free what PETSc holds; as `PetscObjects` calls it.  Collective."""
        for thing in self._things():
            thing.destroy()

    def incRef(self):  # noqa: N802, PETSc's name
        """Keep what PETSc holds for good; as `PetscObjects` calls it.  Local."""
        for thing in self._things():
            thing.incRef()


def within_blocks(matrix, blocks):
    """The entries of a matrix that couple unknowns of one block.

    Collective.

    Args:
        matrix: PETSc BAIJ matrix of nodes, in blocks of 3 x 3.
        blocks: (n,) int, block of each of this rank's nodes.

    Returns:
        PETSc BAIJ matrix of the same layout.
    """
    local = matrix.getDiagonalBlock().convert(PETSc.Mat.Type.AIJ, PETSc.Mat())
    indptr, indices, values = local.getValuesCSR()
    local.destroy()
    entries = csr_matrix((values, indices, indptr)).tocoo()
    inside = blocks[entries.row // 3] == blocks[entries.col // 3]
    places = entries.row[inside], entries.col[inside]
    entries = coo_matrix((entries.data[inside], places), shape=(3 * len(blocks),) * 2).tobsr((3, 3))
    result = PETSc.Mat().create(matrix.comm)
    result.setSizes(matrix.getSizes(), bsize=3)
    result.setType(PETSc.Mat.Type.BAIJ)
    result.setPreallocationNNZ((np.diff(entries.indptr), np.zeros(len(blocks), dtype=np.int32)))
    first = matrix.getOwnershipRange()[0] // 3
    add_blocks(result, entries, np.arange(first, first + len(blocks), dtype=np.int32))
    result.assemble()
    return result
