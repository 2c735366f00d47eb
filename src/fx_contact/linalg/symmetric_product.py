"""Product of a matrix in symmetric blocks of 3 (SBAIJ) with a vector.

PETSc's (`MatMult_SeqSBAIJ_3`) adds each block of a row to sums in memory and waits for them: 1.3 to 2 times the time of
the same loop with the sums in registers (`studies.cost.products`).
"""

import ctypes

from mpi4py import MPI
from petsc4py import PETSc

from fx_contact.linalg.petsc_objects import bool_type
from fx_contact.parallel.compilation import library

#: PETSc's functions that the product calls: name -> types of their arguments.
_CALLED = {
    "MatGetRowIJ": "void *, Index, Bool, Bool, Index *, const Index **, const Index **, Bool *",
    "MatSeqSBAIJGetArray": "void *, const double **",
    "VecGetArrayRead": "void *, const double **",
    "VecGetArrayWrite": "void *, double **",
    "VecRestoreArrayWrite": "void *, double **",
    "VecRestoreArrayRead": "void *, const double **",
    "MatSeqSBAIJRestoreArray": "void *, const double **",
    "MatRestoreRowIJ": "void *, Index, Bool, Bool, Index *, const Index **, const Index **, Bool *",
}
_POINTERS = "".join(f"static int (*{name})({types});\n" for name, types in _CALLED.items())
_SOURCE = (
    f"""
#include <stdint.h>
typedef {bool_type().__name__.replace("c_bool", "_Bool").removeprefix("c_")} Bool;
typedef int{8 * PETSc.IntType().itemsize}_t Index;
{_POINTERS}
void use(void **petsc)
{{
    {' '.join(f"{name} = petsc[{number}];" for number, name in enumerate(_CALLED))}
}}
"""
    + """
/* y = A x by the blocks of each row on the diagonal, whole, and right of it; a block is stored by columns. */
static void multiply(Index rows, const Index *first, const Index *column, const double *block,
                     const double *restrict x, double *restrict y)
{
    for (Index i = 0; i < 3 * rows; i++)
        y[i] = 0;
    for (Index i = 0; i < rows; i++) {
        double sum[3] = {0, 0, 0};
        for (Index k = first[i]; k < first[i + 1]; k++) {
            const Index j = column[k];
            const double *b = block + 9 * (int64_t)k;
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

/* As PETSc calls it: Mat, Vec, Vec; its error code. */
int product(void *mat, void *vec_x, void *vec_y)
{
    Index rows;
    const Index *first, *column;
    const double *block, *x;
    double *y;
    Bool done;
    int code;
    if ((code = MatGetRowIJ(mat, 0, 0, 1, &rows, &first, &column, &done)) ||
        (code = MatSeqSBAIJGetArray(mat, &block)) || (code = VecGetArrayRead(vec_x, &x)) ||
        (code = VecGetArrayWrite(vec_y, &y)))
        return code;
    multiply(rows, first, column, block, x, y);
    if ((code = VecRestoreArrayWrite(vec_y, &y)) || (code = VecRestoreArrayRead(vec_x, &x)) ||
        (code = MatSeqSBAIJRestoreArray(mat, &block)))
        return code;
    return MatRestoreRowIJ(mat, 0, 0, 1, &rows, &first, &column, &done);
}
"""
)

_MATOP_MULT = 3  # of PETSc's petscmat.h


def product_library(comm: MPI.Intracomm) -> ctypes.CDLL:
    """The compiled product.

    Collective on comm.  Raises CompilationError as `library`.
    """
    result, petsc = library(comm, _SOURCE), ctypes.CDLL(PETSc.__file__)
    addresses = [ctypes.cast(petsc[name], ctypes.c_void_p) for name in _CALLED]
    result.use((ctypes.c_void_p * len(addresses))(*addresses))
    return result


def replace_product(mat: PETSc.Mat, compiled: ctypes.CDLL) -> None:
    """Replace PETSc's product with this rank's diagonal block of a preallocated SBAIJ matrix, columns of its own nodes.

    Local.  The blocks in columns of other ranks and the exchange stay PETSc's.  Another preallocation undoes it.
    """
    block = ctypes.c_void_p(mat.getDiagonalBlock().handle)
    ctypes.CDLL(PETSc.__file__).MatSetOperation(block, _MATOP_MULT, compiled.product)  # petsc4py lacks it
