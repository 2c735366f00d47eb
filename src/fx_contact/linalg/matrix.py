"""The conforming matrix: blocks of 3 x 3, for p-multigrid the diagonal and what is above it, or hypre's format.

A product reads each stored block once: half of them if the matrix is symmetric, by our own loop (`symmetric_product`).
PETSc's conversion to hypre's format goes through coordinate lists and keeps them, three times the memory of the matrix.
Copied into preallocated rows, the matrix exists twice during the copy, and once during the solve.
"""

import ctypes
from dataclasses import dataclass

import numpy as np
from dolfinx.common import IndexMap
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_matrix, spmatrix

from fx_contact.linalg.petsc_objects import clear_hypre_errors
from fx_contact.linalg.symmetric_product import product_library, replace_product
from fx_contact.parallel.arrays import FloatArray, Int32Array
from fx_contact.parallel.errors import SolveError
from fx_contact.parallel.exchange import Exchange
from fx_contact.parallel.memory import check_memory
from fx_contact.parallel.mpi import together

#: Memory that a block of 3 x 3 takes in the preconditioner, with it in the matrix, and in a copy in hypre's format.  A
#: block of a symmetric matrix stands for two in the preconditioner.
_PRECONDITIONER_BYTES = 50
_BLOCK_BYTES, _COPY_BYTES = 76 + _PRECONDITIONER_BYTES, 108
#: Part of the diagonal that makes a matrix definite: above rounding, below the stiffness of a body of a million nodes.
_REGULAR = 1e-10


@dataclass(frozen=True, eq=False)
class BlockMatrix:
    """A square matrix on the conforming unknowns.

    Attributes:
        mat: BAIJ with blocks of 3, or SBAIJ, from whose additions PETSc drops the blocks below the diagonal.
        row_lengths: two (owned,), blocks stored of each owned row, in columns of this rank and of others.
        held: (owned, 3), forces K u_D of the prescribed displacements, which are eliminated, where unknowns are free
            [N]; None: nothing is eliminated.
    """

    comm: MPI.Intracomm
    mat: PETSc.Mat
    row_lengths: tuple[Int32Array, Int32Array]
    held: FloatArray | None = None

    @property
    def symmetric(self) -> bool:
        """True if the blocks below the diagonal are not stored.  Local."""
        return is_symmetric(self.mat)

    def in_format_of(self, kind: str) -> PETSc.Mat:
        """The matrix for a type of PC: for hypre's a copy in the place of a BAIJ matrix.  Collective on comm."""
        if kind != PETSc.PC.Type.HYPRE or self.symmetric:
            return self.mat
        result = self._in_hypre_format()
        self.mat.destroy()
        return result

    def _in_hypre_format(self) -> PETSc.Mat:
        """A copy of a BAIJ matrix in hypre's format, with a fixed sparsity pattern.

        All preallocated entries must be set, zeros too (`penalty_term.reserve`): PETSc reads rows to their allocated
        ends.
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


def create_matrix(comm: MPI.Intracomm, graph: csr_matrix, imap: IndexMap, symmetric: bool = False) -> BlockMatrix:
    """An empty matrix with room for the couplings of nodes, no more.

    Collective on comm.  The graph, bool and square, has the couplings known to this rank, of the nodes of `imap`, owned
    and ghosts.  A `symmetric` matrix, for p-multigrid, is SBAIJ; other preconditioners take a copy in AIJ.

    Raises:
        SolveError: the matrix and its preconditioner would not fit into the memory that the hosts have left.
        CompilationError: as `library`, of a symmetric matrix.
    """
    lengths = _row_lengths(comm, graph, imap, symmetric)
    block = _BLOCK_BYTES + (_PRECONDITIONER_BYTES if symmetric else _COPY_BYTES)
    needed = block * sum(int(length.sum()) for length in lengths)
    what = f"the system of {3 * imap.size_global:,} unknowns"
    check_memory(comm, what, needed, "ask for a larger tolerance, or use more hosts")
    compiled = product_library(comm) if symmetric else None
    mat = PETSc.Mat().create(comm)
    mat.setSizes([[3 * imap.size_local, 3 * imap.size_global]] * 2, bsize=3)
    mat.setType(PETSc.Mat.Type.SBAIJ if symmetric else PETSc.Mat.Type.BAIJ)
    mat.setPreallocationNNZ(lengths)
    if compiled is not None:
        mat.setOption(PETSc.Mat.Option.IGNORE_LOWER_TRIANGULAR, True)
        replace_product(mat, compiled)
    # PETSc sets it where there are rows; where a rank has none the collectives of the assembly would not match.
    mat.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, True)
    return BlockMatrix(comm, mat, lengths)


def add_blocks(mat: PETSc.Mat, product: spmatrix, number: Int32Array) -> None:
    """Add a product (3 n, 3 n) to a matrix in blocks of 3, zeros too, at n blocks by their global numbers.  Local."""
    blocks = product.tobsr((3, 3))
    rows = np.flatnonzero(np.diff(blocks.indptr))
    indptr = np.append(blocks.indptr[rows], len(blocks.indices)).astype(np.int32)
    columns, add = number[blocks.indices], PETSc.InsertMode.ADD
    mat.setValuesBlockedIJV(indptr, columns, blocks.data, addv=add, rowmap=number[rows])


def shift_diagonal(mat: PETSc.Mat) -> None:
    """Add a small part of the diagonal to a positive semidefinite matrix.  Collective on mat.comm."""
    diagonal = mat.getDiagonal()
    diagonal.scale(_REGULAR)
    mat.setDiagonal(diagonal, PETSc.InsertMode.ADD)
    diagonal.destroy()


def is_symmetric(mat: PETSc.Mat) -> bool:
    """True if a matrix is SBAIJ.  Local."""
    return "sbaij" in mat.type


def diagonal_blocks(mat: PETSc.Mat) -> PETSc.Mat:
    """The 3 x 3 blocks on the diagonal of an SBAIJ matrix as BAIJ, for smoothers; of another format the matrix itself.

    Collective on mat.comm.  Not to be destroyed by the caller: Python's references do that.
    """
    if not is_symmetric(mat):
        return mat
    here = mat.getDiagonalBlock()
    indptr, _ = here.getRowIJ(compressed=True)
    values, lib = ctypes.c_void_p(), ctypes.CDLL(PETSc.__file__)  # petsc4py lacks the array
    lib.MatSeqSBAIJGetArray(ctypes.c_void_p(here.handle), ctypes.byref(values))
    count, blocks = len(indptr) - 1, np.zeros((0, 9))
    if count:  # else there is no array
        every = np.ctypeslib.as_array(ctypes.cast(values, ctypes.POINTER(ctypes.c_double)), (9 * int(indptr[-1]),))
        blocks = every.reshape(-1, 9)[indptr[:-1]]  # the diagonal one is the first of its row
    lib.MatSeqSBAIJRestoreArray(ctypes.c_void_p(here.handle), ctypes.byref(values))
    first = mat.getOwnershipRange()[0] // 3
    csr = np.arange(count + 1, dtype=PETSc.IntType), first + np.arange(count, dtype=PETSc.IntType), blocks.ravel()
    return PETSc.Mat().createBAIJ(mat.getSizes(), 3, csr=csr, comm=mat.comm)


def distributed(comm: MPI.Intracomm, matrix: csr_matrix, columns: IndexMap) -> PETSc.Mat:
    """AIJ matrix of each rank's rows (n, 3 m), three columns for each node of an index map.  Collective on comm."""
    number = columns.local_to_global(np.arange(columns.size_local + columns.num_ghosts, dtype=np.int32))
    number = (3 * number[:, None] + np.arange(3)).ravel().astype(PETSc.IntType)
    sizes = (matrix.shape[0], None), (3 * columns.size_local, 3 * columns.size_global)
    csr = matrix.indptr.astype(PETSc.IntType), number[matrix.indices], matrix.data
    return PETSc.Mat().createAIJ(sizes, csr=csr, comm=comm)


def as_aij(mat: PETSc.Mat) -> PETSc.Mat:
    """A copy of a symmetric positive definite matrix in PETSc's own format.  Collective on mat.comm."""
    copy = mat.convert(PETSc.Mat.Type.AIJ, PETSc.Mat())
    copy.setBlockSizes(*mat.getBlockSizes())  # hypre's format has no block size, which adding blocks needs
    copy.setOption(PETSc.Mat.Option.SPD, True)  # MUMPS needs no pivoting
    return copy


def _row_lengths(
    comm: MPI.Intracomm, graph: csr_matrix, imap: IndexMap, symmetric: bool
) -> tuple[Int32Array, Int32Array]:
    """Blocks of each owned row in columns of this rank and of others, exactly; symmetric: not below the diagonal."""
    size, owned = imap.size_local + imap.num_ghosts, imap.size_local
    number = imap.local_to_global(np.arange(size, dtype=np.int32))
    rows, columns = np.repeat(np.arange(size), np.diff(graph.indptr)), graph.indices
    if symmetric:
        above = number[columns] >= number[rows]
        rows, columns = rows[above], columns[above]
    near = np.bincount(rows[columns < owned], minlength=size)[:owned]
    far = np.bincount(rows[columns >= owned], minlength=size)[:owned]

    # Rows with couplings of several ranks: the union of their columns, by global numbers.
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
