"""The coarse level of p-multigrid: its matrix, with the springs of closed contact, and the interpolation from it.

Beside it what the smoother above needs to know of the mesh: blocks of nodes to be solved for at once.
"""

import numpy as np
from petsc4py import PETSc

from fx_contact.parallel.exchange import Exchange


class CoarseLevel:
    """A coarse matrix K_c and the interpolation I from its unknowns; with springs K_c + (B I)^T k B I.

    Collective.

    Args:
        matrix: PETSc AIJ matrix K_c, without springs; changed when these do.
        interpolation: PETSc AIJ matrix I, fine unknowns by coarse ones.
        blocks: (n,) int64, for the smoother the block of each of this rank's fine nodes, as `flat_cells.strong_blocks`
            gives it; None: a node is a block.

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
        blocks: (n,) int64, block of each of this rank's nodes, as `CoarseLevel` has them.

    Returns:
        PETSc AIJ matrix of the same layout.
    """
    aij = matrix.convert(PETSc.Mat.Type.AIJ, PETSc.Mat())
    indptr, indices, values = aij.getValuesCSR()
    aij.destroy()
    inside = np.repeat(blocks, 3 * np.diff(indptr)[::3]) == _of_nodes(matrix, blocks, indices // 3)
    csr = np.append(0, np.cumsum(inside))[indptr].astype(PETSc.IntType), indices[inside], values[inside]
    return PETSc.Mat().createAIJ(matrix.getSizes(), bsize=3, csr=csr, comm=matrix.comm)


def solved_here(matrix, blocks):
    """The unknowns of the blocks that this rank solves for.

    Collective.

    Args:
        matrix, blocks: as in `within_blocks`.

    Returns:
        PETSc IS of global numbers.
    """
    nodes = matrix.getOwnershipRange()[0] // 3 + np.arange(len(blocks))
    nodes = Exchange(matrix.comm.tompi4py(), blocks % matrix.comm.size).forward(nodes)
    return PETSc.IS().createBlock(3, np.sort(nodes).astype(PETSc.IntType), PETSc.COMM_SELF)


def _of_nodes(matrix, blocks, nodes):
    """The blocks, (k,) int64, of nodes of any ranks, (k,) int global numbers.  Collective."""
    first = matrix.getOwnershipRange()[0] // 3
    result, foreign = np.empty(len(nodes), dtype=np.int64), (nodes < first) | (nodes >= first + len(blocks))
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
