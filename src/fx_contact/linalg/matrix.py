"""The conforming matrix: blocks of 3 x 3 for assembly, then hypre's format if hypre is the preconditioner.

PETSc's conversion to hypre's format goes through coordinate lists and keeps them, three times the memory of the matrix.
Copied into preallocated rows, the matrix exists twice for a moment, and once during the solve.
"""

import ctypes
from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc
from scipy.sparse import csr_matrix

from fx_contact.parallel.errors import SolveError
from fx_contact.parallel.exchange import Exchange
from fx_contact.parallel.memory import check_memory
from fx_contact.parallel.mpi import together

#: Memory that a block of 3 x 3 takes in the matrix, in the preconditioner, and in a copy in hypre's format.
_BLOCK_BYTES, _COPY_BYTES = 76 + 50, 108


@dataclass(frozen=True, eq=False)
class BlockMatrix:
    """A square matrix on the conforming unknowns.

    Attributes:
        comm: MPI communicator, the one of the run.
        mat: PETSc BAIJ matrix with blocks of 3.
        row_lengths: two (owned,) int32, blocks of each owned row in columns of this rank and of others.
    """

    comm: object
    mat: PETSc.Mat
    row_lengths: tuple[np.ndarray, np.ndarray]

    def in_hypre_format(self):
        """A copy in hypre's format.

        Collective on mat.comm.  Its entries can be changed, new ones cannot be added.  Every preallocated entry must
        have been set, zeros too (`PenaltyTerm.reserve`): PETSc reads rows to their allocated ends.

        Returns:
            PETSc Mat of type hypre.

        Raises:
            SolveError: PETSc has no memory for it, or no hypre.
        """
        result = PETSc.Mat().create(self.mat.comm)
        result.setSizes(self.mat.getSizes(), bsize=3)
        result.setType(PETSc.Mat.Type.HYPRE)
        result.setOption(PETSc.Mat.Option.SORTED_FULL, True)
        near, far = (np.repeat(3 * lengths, 3).astype(PETSc.IntType) for lengths in self.row_lengths)
        preallocate = ctypes.CDLL(PETSc.__file__).MatHYPRESetPreallocation  # petsc4py lacks it
        none = np.ctypeslib.as_ctypes_type(PETSc.IntType)(0)
        with together(self.comm):
            if preallocate(ctypes.c_void_p(result.handle), none, near.ctypes, none, far.ctypes):
                clear_hypre_errors()
                raise SolveError("PETSc cannot allocate a matrix in hypre's format")
        self.mat.copy(result, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        return result


def create_matrix(prolongation, cells, rows, copied=True):
    """An empty conforming matrix with room for P^T K P and the contact blocks, no more.

    Collective on prolongation.comm.

    Args:
        prolongation: Prolongation.
        cells: (ncells, k) int32, position in the prolongation's space of each local cell's nodes.
        rows: ConstraintRows or None.
        copied: whether the preconditioner will need a copy of it; p-multigrid does not.

    Returns:
        BlockMatrix.

    Raises:
        SolveError: the matrix and its preconditioner would not fit into the memory that the hosts have left.
    """
    imap, lengths = prolongation.index_map, _row_lengths(prolongation, cells, rows)
    check_memory(
        prolongation.comm,
        f"the system of {3 * imap.size_global:,} unknowns",
        (_BLOCK_BYTES + copied * _COPY_BYTES) * sum(int(length.sum()) for length in lengths),
        "ask for a larger tolerance, or use more hosts",
    )
    mat = PETSc.Mat().create(prolongation.comm)
    mat.setSizes([[3 * imap.size_local, 3 * imap.size_global]] * 2, bsize=3)
    mat.setType(PETSc.Mat.Type.BAIJ)
    mat.setPreallocationNNZ(lengths)
    # PETSc sets it where there are rows; where a rank has none the collectives of the assembly would not match.
    mat.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, True)
    return BlockMatrix(prolongation.comm, mat, lengths)


def add_blocks(mat, product, number):
    """Add a product on this rank's unknowns to a matrix, zeros too.  Local.

    Args:
        mat: PETSc Mat in blocks of 3.
        product: (3 n, 3 n) scipy sparse float64.
        number: (n,) int32, global number of each block.
    """
    product = product.tobsr((3, 3))
    rows = np.flatnonzero(np.diff(product.indptr))
    indptr = np.append(product.indptr[rows], len(product.indices)).astype(np.int32)
    mat.setValuesBlockedIJV(
        indptr, number[product.indices], product.data, addv=PETSc.InsertMode.ADD, rowmap=number[rows]
    )


def distributed(comm, matrix, columns):
    """This rank's rows of a matrix as a part of one of PETSc's.

    Collective on comm.

    Args:
        comm: MPI communicator.
        matrix: (n, 3 m) scipy CSR float64, rows of this rank.
        columns: IndexMap of m nodes, owned and ghosts, of three unknowns each.

    Returns:
        PETSc Mat of type AIJ.
    """
    number = columns.local_to_global(np.arange(columns.size_local + columns.num_ghosts, dtype=np.int32))
    number = (3 * number[:, None] + np.arange(3)).ravel().astype(PETSc.IntType)
    sizes = (matrix.shape[0], None), (3 * columns.size_local, 3 * columns.size_global)
    csr = matrix.indptr.astype(PETSc.IntType), number[matrix.indices], matrix.data
    return PETSc.Mat().createAIJ(sizes, csr=csr, comm=comm)


def clear_hypre_errors():
    """Clear hypre's error flag: it stays after a failure, and every later call would report it.  Local."""
    clear = getattr(ctypes.CDLL(PETSc.__file__), "HYPRE_ClearAllErrors", None)
    if clear is not None:
        clear()


def _row_lengths(prolongation, cells, rows_of_contact):
    """Blocks of each owned row in columns of this rank and of others, exactly: two (owned,) int32."""
    imap, comm = prolongation.index_map, prolongation.comm
    size, owned = imap.size_local + imap.num_ghosts, imap.size_local
    nodes = csr_matrix(
        (np.ones(cells.size, dtype=bool), cells.ravel(), np.arange(0, cells.size + 1, cells.shape[1])),
        shape=(len(cells), len(prolongation.space)),
    )
    touches = nodes @ prolongation.matrix.astype(bool)
    graph = touches.T @ touches
    if rows_of_contact is not None:
        graph = graph + rows_of_contact.couplings()
    rows, columns = np.repeat(np.arange(size), np.diff(graph.indptr)), graph.indices
    near = np.bincount(rows[columns < owned], minlength=size)[:owned]
    far = np.bincount(rows[columns >= owned], minlength=size)[:owned]

    # Rows of which other ranks have a share: their columns are brought together, by global numbers.
    number = imap.local_to_global(np.arange(size, dtype=np.int32))
    theirs = rows >= owned
    exchange = Exchange(comm, imap.owners[rows[theirs] - owned])
    first = imap.local_range[0]
    place = exchange.forward(number[rows[theirs]]) - first
    shared = np.zeros(size, dtype=bool)
    shared[place] = True
    ours = shared[rows]
    place = np.concatenate([place, rows[ours]])
    column = np.concatenate([exchange.forward(number[columns[theirs]]), number[columns[ours]]])
    place, column = np.divmod(np.unique(place * imap.size_global + column), imap.size_global)
    here = (column >= first) & (column < first + owned)
    shared = shared[:owned]
    near[shared] = np.bincount(place[here], minlength=owned)[shared]
    far[shared] = np.bincount(place[~here], minlength=owned)[shared]
    return near.astype(np.int32), far.astype(np.int32)
