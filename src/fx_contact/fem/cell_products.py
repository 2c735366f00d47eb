"""P^T K P from the dense matrices of cells, many at a time.

A cell's nodes that hang have masters, of which the cell's own nodes may be some.  With C the rows of P of the cell's
nodes, in the columns of all their masters, the cell adds C^T K_T C to the matrix.  At degree 2 no master hangs itself
and C is square.  The idea: P. Munch, K. Ljungkvist, M. Kronbichler, ISC High Performance 2022, LNCS 13289.
"""

import numpy as np
from dolfinx import fem


def cell_matrices(form, rows, columns):
    """The matrices of the cells that a form integrates over, its functions discontinuous, scalar or in blocks of 3.

    Collective on the mesh's communicator.

    Args:
        form: dolfinx Form, bilinear.
        rows, columns: (n, k) and (n, l) int32, the dofmaps of those cells.

    Returns:
        (n,) int64, the cells in the order of their rows, as positions in `rows`, and their matrices: (n, k, l, 3, 3)
        float64, or (n, k, l) of scalars; the k and l nodes in the order of the element.
    """
    matrix = fem.create_matrix(form)
    fem.assemble_matrix(matrix, form)
    blocks = () if set(matrix.block_size) == {1} else tuple(matrix.block_size)
    return np.argsort(rows[:, 0]), matrix.data.reshape(-1, rows.shape[1], columns.shape[1], *blocks)


def cell_constraints(prolongation, cells):
    """The masters of the nodes of cells, and their weights.

    Local.

    Args:
        prolongation: Prolongation.
        cells: (n, k) int, position in the prolongation's space of the nodes of each cell.

    Returns:
        (n, l) int64 masters of each cell, positions in the prolongation's index map, and the weights C:
        (n, k, l) float64.  Cells with fewer than l masters have one of them twice, with weight 0.
    """
    rows = prolongation.matrix[cells.ravel()]
    width = rows.shape[1]
    row = np.repeat(np.arange(cells.size), np.diff(rows.indptr))
    distinct, place = np.unique(row // cells.shape[1] * width + rows.indices, return_inverse=True)
    cell, master = np.divmod(distinct, width)
    first = np.searchsorted(cell, np.arange(len(cells)))
    local = np.arange(len(distinct)) - first[cell]
    count = local.max(initial=-1) + 1
    masters = np.repeat(master[first][:, None], count, axis=1)
    masters[cell, local] = master
    weights = np.zeros((*cells.shape, count))
    weights[row // cells.shape[1], row % cells.shape[1], local[place]] = rows.data
    return masters, weights


def constrained(matrices, weights):
    """C^T K_T C of symmetric matrices of cells.

    Local.

    Args:
        matrices: (n, k, k, 3, 3) float64.
        weights: (n, k, l) float64.

    Returns:
        (n, l, l, 3, 3) float64.
    """
    n, k, width = weights.shape
    transposed = weights.transpose(0, 2, 1)
    half = (transposed @ matrices.reshape(n, k, 9 * k)).reshape(n, width, k, 3, 3)
    # K is symmetric: the second factor acts on the first index of the transposed half.
    half = half.transpose(0, 2, 1, 4, 3).reshape(n, k, 9 * width)
    return (transposed @ half).reshape(n, width, width, 3, 3)


def add_cells(mat, matrices, nodes):
    """Add matrices of cells to one in blocks of 3.  Local.

    Args:
        mat: PETSc Mat in blocks of 3.
        matrices: (n, k, k, 3, 3) float64.
        nodes: (n, k) int32, global number of the node of each row and column.
    """
    n, k = nodes.shape
    indptr = np.arange(0, n * k * k + 1, k, dtype=np.int32)
    columns = np.repeat(nodes, k, axis=0).ravel()
    mat.setValuesBlockedIJV(indptr, columns, matrices.ravel(), addv=True, rowmap=nodes.ravel())
