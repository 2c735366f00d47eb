"""Product of a matrix in symmetric blocks of 3 (SBAIJ) with a vector.

PETSc's (`MatMult_SeqSBAIJ_3`) adds each block of a row to sums in memory and waits for them: twice the time of the same
loop with the sums in registers (`studies.cost.products`).
"""

import ctypes
from collections.abc import Callable
from functools import cache

from mpi4py import MPI
from petsc4py import PETSc

from fx_contact.parallel.compilation import library

#: y = A x by the rows of blocks on and above the diagonal; a block is stored by columns.
_SOURCE = """
void multiply(INT rows, const INT *first, const INT *column, const double *block,
              const double *restrict x, double *restrict y)
{
    for (INT i = 0; i < 3 * rows; i++)
        y[i] = 0;
    for (INT i = 0; i < rows; i++) {
        double sum[3] = {0, 0, 0};
        for (INT k = first[i]; k < first[i + 1]; k++) {
            const INT j = column[k];
            const double *b = block + 9 * (long)k;
            for (int r = 0; r < 3; r++)
                for (int c = 0; c < 3; c++)
                    sum[r] += b[r + 3 * c] * x[3 * j + c];
            if (j != i)
                for (int r = 0; r < 3; r++)
                    y[3 * j + r] += b[3 * r] * x[3 * i] + b[3 * r + 1] * x[3 * i + 1] + b[3 * r + 2] * x[3 * i + 2];
        }
        for (int r = 0; r < 3; r++)
            y[3 * i + r] += sum[r];
    }
}
""".replace(
    "INT", "int" if PETSc.IntType().itemsize == 4 else "long long"
)

_MULTIPLY = 3  # MATOP_MULT in PETSc's petscmat.h
_Operation = ctypes.CFUNCTYPE(ctypes.c_int, *3 * [ctypes.c_void_p])
_Index = ctypes.c_int if PETSc.IntType().itemsize == 4 else ctypes.c_longlong


def replace_product(comm: MPI.Intracomm, mat: PETSc.Mat) -> None:
    """Let a preallocated SBAIJ matrix multiply its diagonal block of this rank by this loop.

    Collective on comm.  Raises CompilationError as `library`.
    """
    operation = _operation(library(comm, _SOURCE))
    block = ctypes.c_void_p(mat.getDiagonalBlock().handle)
    _petsc().MatSetOperation(block, _MULTIPLY, operation)  # petsc4py lacks it


@cache
def _petsc() -> ctypes.CDLL:
    return ctypes.CDLL(PETSc.__file__)


@cache
def _operation(loops: ctypes.CDLL) -> Callable[..., int]:
    """A function in C that PETSc can call, kept as long as the program: matrices point to it."""
    petsc, at = _petsc(), ctypes.byref

    def product(*handles: int) -> int:
        mat, x, y = map(ctypes.c_void_p, handles)
        first, column, block, here, there = (ctypes.c_void_p() for _ in range(5))
        rows, done = _Index(), ctypes.c_int()
        graph = mat, _Index(0), 0, 1, at(rows), at(first), at(column), at(done)  # in blocks, from 0
        codes = [
            petsc.MatGetRowIJ(*graph),
            petsc.MatSeqSBAIJGetArray(mat, at(block)),
            petsc.VecGetArrayRead(x, at(here)),
            petsc.VecGetArrayWrite(y, at(there)),
        ]
        if any(codes):
            return max(codes)
        loops.multiply(rows, first, column, block, here, there)
        stored = ctypes.cast(first, ctypes.POINTER(_Index))[rows.value]
        PETSc.Log.logFlops(18.0 * (2 * stored - rows.value))
        return max(
            petsc.VecRestoreArrayWrite(y, at(there)),
            petsc.VecRestoreArrayRead(x, at(here)),
            petsc.MatSeqSBAIJRestoreArray(mat, at(block)),
            petsc.MatRestoreRowIJ(*graph),
        )

    return _Operation(product)
