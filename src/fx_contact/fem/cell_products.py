"""P^T K P from dense cell matrices, many at a time.

With C the rows of P of a cell's nodes, restricted to the columns of their masters, the cell adds C^T K_T C to the
matrix.  Masters may be nodes of the cell.  Source: P. Munch, K. Ljungkvist, M. Kronbichler, ISC High Performance 2022,
LNCS 13289.
"""

from dataclasses import replace

import numpy as np
from scipy.sparse import csr_matrix

from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.supports import Supports
from fx_contact.linalg.matrix import BlockMatrix
from fx_contact.parallel.arrays import FloatArray, Int64Array, IntArray


def node_couplings(prolongation: Prolongation, cells: IntArray) -> csr_matrix:
    """Couplings of the nodes of an index map by cells (n, k), nodes of the space: bool.  Local."""
    entries = np.ones(cells.size, dtype=bool), cells.ravel(), np.arange(0, cells.size + 1, cells.shape[1])
    touches = csr_matrix(entries, (len(cells), len(prolongation.space))) @ prolongation.matrix.astype(bool)
    return touches.T @ touches


def cell_constraints(prolongation: Prolongation, cells: IntArray) -> tuple[Int64Array, FloatArray]:
    """Masters (n, l) of the nodes of cells or facets (n, k), and their weights C (n, k, l), 0 where there are fewer.

    Local.  Masters are positions in the index map, nodes in the space; l is at least k.
    """
    rows = prolongation.matrix[cells.ravel()]
    width = rows.shape[1]
    row = np.repeat(np.arange(cells.size), np.diff(rows.indptr))
    distinct, place = np.unique(row // cells.shape[1] * width + rows.indices, return_inverse=True)
    cell, master = np.divmod(distinct, width)
    first = np.searchsorted(cell, np.arange(len(cells)))
    local = np.arange(len(distinct)) - first[cell]
    count = local.max(initial=cells.shape[1] - 1) + 1
    masters = np.repeat(master[first][:, None], count, axis=1)
    masters[cell, local] = master
    weights = np.zeros((*cells.shape, count))
    weights[row // cells.shape[1], row % cells.shape[1], local[place]] = rows.data
    return masters, weights


def constrained(matrices: FloatArray, weights: FloatArray) -> FloatArray:
    """C^T K_T C, (n, l, l, 3, 3), of symmetric cell matrices (n, k, k, 3, 3) and weights (n, k, l).  Local."""
    n, k, width = weights.shape
    transposed = weights.transpose(0, 2, 1)
    half = (transposed @ matrices.reshape(n, k, 9 * k)).reshape(n, width, k, 3, 3)
    # K is symmetric: the second factor acts on the first index of the transposed half.
    half = half.transpose(0, 2, 1, 4, 3).reshape(n, k, 9 * width)
    return (transposed @ half).reshape(n, width, width, 3, 3)


class CellSum:
    """The sum of cell matrices on the unknowns that supports leave free.

    Collective on prolongation.comm.

    Args:
        matrix: with room for the couplings of the cells.
        supports: at the owned conforming nodes, to eliminate; None: nothing is eliminated.
    """

    def __init__(self, prolongation: Prolongation, matrix: BlockMatrix, supports: Supports | None) -> None:
        self._prolongation, self._matrix = prolongation, matrix
        self._supports = None if supports is None else supports.ghosted(prolongation)
        self._number, self._held = prolongation.numbers, prolongation.zeros(3)

    def add(self, matrices: FloatArray, nodes: IntArray) -> None:
        """Add cell matrices (n, k, k, 3, 3), which are changed, at positions (n, k) in the index map.  Local."""
        n, k = nodes.shape
        if self._supports is not None:
            cells, forces = self._supports.eliminate(matrices, nodes)
            np.add.at(self._held, nodes[cells], forces)
        number = self._number[nodes]
        indptr, columns = np.arange(0, n * k * k + 1, k, dtype=np.int32), np.repeat(number, k, axis=0).ravel()
        self._matrix.mat.setValuesBlockedIJV(indptr, columns, matrices.ravel(), addv=True, rowmap=number.ravel())

    def result(self) -> BlockMatrix:
        """The matrix, not yet assembled, with the forces of prescribed displacements.  Collective."""
        held = None if self._supports is None else self._prolongation.summed(self._held)
        return replace(self._matrix, held=held)
