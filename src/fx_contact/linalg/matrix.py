"""The conforming matrix: in blocks of 3 x 3, in hypre's format, or cell by cell with the entries of contact beside it.

PETSc's conversion to hypre's format goes through coordinate lists and keeps them, three times the memory of the matrix.
Copied into preallocated rows, the matrix exists twice during the copy, and once during the solve.
"""

from __future__ import annotations

import ctypes
from abc import abstractmethod
from dataclasses import dataclass, replace

import numpy as np
from dolfinx.common import IndexMap
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import bsr_matrix, csr_matrix, spmatrix

from fx_contact.linalg.operator import Operator
from fx_contact.linalg.petsc_objects import clear_hypre_errors
from fx_contact.parallel.arrays import FloatArray, Int32Array
from fx_contact.parallel.errors import SolveError
from fx_contact.parallel.exchange import Exchange
from fx_contact.parallel.memory import check_memory
from fx_contact.parallel.mpi import together

#: Memory that a block of 3 x 3 takes in the matrix with its preconditioner, and in a copy in hypre's format.
_BLOCK_BYTES, _COPY_BYTES = 126, 108
#: Part of the diagonal that makes a matrix definite: above rounding, below the stiffness of a body of a million nodes.
_REGULAR = 1e-10


class CellOperator(Operator):
    """A symmetric positive operator that is applied cell by cell, without entries."""

    @abstractmethod
    def blocks(self) -> FloatArray:
        """(owned, 3, 3), its blocks on the diagonal, or close to them [N/m].  Collective."""

    @abstractmethod
    def energy(self, u: FloatArray) -> float:
        """This rank's part of u^T A u of (owned, 3) [m], prescribed displacements included [J].  Collective."""

    @abstractmethod
    def assembled(self) -> BlockMatrix:
        """Matrix with all entries, before `mat.assemble`.  Collective."""


class _Sum:
    """A `CellOperator` and a matrix of entries: the context of PETSc's shell matrix of their sum."""

    def __init__(self, operator: CellOperator, entries: PETSc.Mat, blocks: PETSc.Mat) -> None:
        self.operator, self.entries, self.blocks = operator, entries, blocks
        self._assembled: PETSc.Mat | None = None  # the operator, kept for factors, which take many times its memory

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Product of the sum."""
        self.entries.mult(x, y)
        self.operator.add_product(x.array_r.reshape(-1, 3), y.array.reshape(-1, 3))

    def getDiagonal(self, _: PETSc.Mat, diagonal: PETSc.Vec) -> None:  # noqa: N802, PETSc's name
        """Diagonal of the sum."""
        self.blocks.getDiagonal(diagonal)

    def assemblyEnd(self, *_: object) -> None:  # noqa: N802, PETSc's name
        """Assembly of what was added."""
        self.entries.assemble()
        self.blocks.assemble()

    def whole(self) -> PETSc.Mat:
        """All entries, BAIJ.  Collective."""
        if self._assembled is None:
            self._assembled = self.operator.assembled().mat
            self._assembled.assemble()
        result = self._assembled.copy()
        result.axpy(1.0, self.entries, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        return result

    def destroy(self, _: PETSc.Mat) -> None:
        """Release of all matrices."""
        for mat in (self.entries, self.blocks, self._assembled):
            if mat is not None:
                mat.destroy()


@dataclass(frozen=True, eq=False)
class BlockMatrix:
    """A square matrix on the conforming unknowns.

    Attributes:
        mat: BAIJ with blocks of 3, or PETSc's "python" of `with_operator`.
        row_lengths: two (owned,), blocks stored of each owned row, in columns of this rank and of others.
        held: (owned, 3), forces K u_D of the prescribed displacements, which are eliminated, where unknowns are free
            [N]; None: nothing is eliminated.
    """

    comm: MPI.Intracomm
    mat: PETSc.Mat
    row_lengths: tuple[Int32Array, Int32Array]
    held: FloatArray | None = None

    @property
    def operator(self) -> CellOperator | None:
        """The operator applied cell by cell; None: all entries are stored."""
        beside = _sum_of(self.mat)
        return None if beside is None else beside.operator

    def in_format_of(self, kind: str) -> PETSc.Mat:
        """The matrix for a type of PC: for hypre's a copy of a BAIJ matrix in its place, with a fixed sparsity pattern.

        Collective on comm.  All preallocated entries must be set, zeros too (`penalty_term.reserve`): PETSc reads rows
        to their allocated ends.  Raises SolveError: there is no memory for the copy.
        """
        if kind != PETSc.PC.Type.HYPRE or self.operator is not None:
            return self.mat
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
        self.mat.destroy()
        return result


def create_matrix(comm: MPI.Intracomm, graph: csr_matrix, imap: IndexMap) -> BlockMatrix:
    """An empty matrix with room for the couplings of nodes, no more.

    Collective on comm.  The graph, bool and square, has the couplings known to this rank, of the nodes of `imap`, owned
    and ghosts.

    Raises:
        SolveError: the matrix and its preconditioner would not fit into the memory that the hosts have left.
    """
    lengths = _row_lengths(comm, graph, imap)
    needed = (_BLOCK_BYTES + _COPY_BYTES) * sum(int(length.sum()) for length in lengths)
    what = f"the system of {3 * imap.size_global:,} unknowns"
    check_memory(comm, what, needed, "ask for a larger tolerance, or use more hosts")
    mat = PETSc.Mat().create(comm)
    mat.setSizes([[3 * imap.size_local, 3 * imap.size_global]] * 2, bsize=3)
    mat.setType(PETSc.Mat.Type.BAIJ)
    mat.setPreallocationNNZ(lengths)
    # PETSc sets it where there are rows; where a rank has none the collectives of the assembly would not match.
    mat.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, True)
    return BlockMatrix(comm, mat, lengths)


def with_operator(operator: CellOperator, entries: BlockMatrix) -> BlockMatrix:
    """The sum of an operator and a matrix, to whose entries `add_blocks` adds.  Collective on entries.comm."""
    mat = PETSc.Mat().create(entries.comm)
    mat.setSizes(entries.mat.getSizes(), bsize=3)
    mat.setType(PETSc.Mat.Type.PYTHON)
    mat.setPythonContext(_Sum(operator, entries.mat, _block_diagonal(entries.mat, operator.blocks())))
    mat.setUp()
    return replace(entries, mat=mat)


def _sum_of(mat: PETSc.Mat) -> _Sum | None:
    return mat.getPythonContext() if mat.type == PETSc.Mat.Type.PYTHON else None


def _block_diagonal(mat: PETSc.Mat, blocks: FloatArray) -> PETSc.Mat:
    """Symmetric blocks (owned, 3, 3) as BAIJ with the layout of a matrix."""
    first, count = mat.getOwnershipRange()[0] // 3, len(blocks)
    each = np.arange(count + 1, dtype=PETSc.IntType)
    csr = each, first + each[:-1], blocks.ravel()
    return PETSc.Mat().createBAIJ(mat.getSizes(), 3, csr=csr, comm=mat.comm)


def add_blocks(mat: PETSc.Mat, product: spmatrix, number: Int32Array) -> None:
    """Add a product (3 n, 3 n) to a matrix in blocks of 3, zeros too, at n blocks by their global numbers.  Local."""
    blocks = product.tobsr((3, 3))
    beside = _sum_of(mat)
    if beside is not None:
        row = np.repeat(np.arange(len(number)), np.diff(blocks.indptr))
        on = blocks.indices == row
        first = np.searchsorted(row[on], np.arange(len(number) + 1))
        of_nodes = bsr_matrix((blocks.data[on], row[on], first), shape=blocks.shape)
        add_blocks(beside.blocks, of_nodes, number)
    rows = np.flatnonzero(np.diff(blocks.indptr))
    indptr = np.append(blocks.indptr[rows], len(blocks.indices)).astype(np.int32)
    columns, add = number[blocks.indices], PETSc.InsertMode.ADD
    mat = mat if beside is None else beside.entries
    mat.setValuesBlockedIJV(indptr, columns, blocks.data, addv=add, rowmap=number[rows])


def shift_diagonal(mat: PETSc.Mat) -> None:
    """Add a small part of the diagonal to a positive semidefinite matrix.  Collective on mat.comm."""
    diagonal = mat.getDiagonal()
    diagonal.scale(_REGULAR)
    mat.setDiagonal(diagonal, PETSc.InsertMode.ADD)
    diagonal.destroy()


def diagonal_blocks(mat: PETSc.Mat) -> PETSc.Mat:
    """The 3 x 3 blocks on the diagonal of a sum with an operator, a copy in BAIJ for smoothers; else the matrix itself.

    Collective on mat.comm.  Not to be destroyed by the caller: Python's references do that.  A copy, since PETSc keeps
    the inverses of blocks whose matrix changes.
    """
    beside = _sum_of(mat)
    return mat if beside is None else beside.blocks.copy()


def distributed(comm: MPI.Intracomm, matrix: csr_matrix, columns: IndexMap) -> PETSc.Mat:
    """AIJ matrix of each rank's rows (n, 3 m), three columns for each node of an index map.  Collective on comm."""
    number = columns.local_to_global(np.arange(columns.size_local + columns.num_ghosts, dtype=np.int32))
    number = (3 * number[:, None] + np.arange(3)).ravel().astype(PETSc.IntType)
    sizes = (matrix.shape[0], None), (3 * columns.size_local, 3 * columns.size_global)
    csr = matrix.indptr.astype(PETSc.IntType), number[matrix.indices], matrix.data
    return PETSc.Mat().createAIJ(sizes, csr=csr, comm=comm)


def as_aij(mat: PETSc.Mat) -> PETSc.Mat:
    """A copy of a symmetric positive definite matrix in PETSc's own format.  Collective on mat.comm."""
    beside = _sum_of(mat)
    whole = mat if beside is None else beside.whole()
    copy = whole.convert(PETSc.Mat.Type.AIJ, PETSc.Mat())
    if whole is not mat:
        whole.destroy()
    copy.setBlockSizes(*mat.getBlockSizes())  # hypre's format has no block size, which adding blocks needs
    copy.setOption(PETSc.Mat.Option.SPD, True)  # MUMPS needs no pivoting
    return copy


def _row_lengths(comm: MPI.Intracomm, graph: csr_matrix, imap: IndexMap) -> tuple[Int32Array, Int32Array]:
    """Blocks of each owned row in columns of this rank and of others, exactly."""
    size, owned = imap.size_local + imap.num_ghosts, imap.size_local
    number = imap.local_to_global(np.arange(size, dtype=np.int32))
    rows, columns = np.repeat(np.arange(size), np.diff(graph.indptr)), graph.indices
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
