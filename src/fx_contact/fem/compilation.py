"""Compilation of all UFL forms, with the same typed error on all ranks."""

import ufl
from dolfinx import fem, jit
from mpi4py import MPI

from fx_contact.parallel.errors import CompilationError

#: Flags of the C compiler that allow reordered sums, to vectorise loops over basis functions.  The internal
#: forces of a cell of degree 2 take 17 microseconds with -O2, DOLFINx's default, and 9 with these.
_FLAGS = ["-O3", "-fno-math-errno", "-fno-signed-zeros", "-fno-trapping-math", "-fassociative-math"]
_ARGS = "cffi_extra_compile_args"


def _flags() -> list[str]:
    """Flags, followed by those of the user's file of JIT options if it changes DOLFINx's default."""
    given = jit.get_options()[_ARGS]
    return _FLAGS if given == jit.DOLFINX_DEFAULT_JIT_OPTIONS[_ARGS][0] else [*_FLAGS, *given]


def compiled(comm: MPI.Intracomm, form: ufl.Form) -> fem.Form:
    """Compile a form, or take it from FFCx's cache.

    Collective on comm, the user's communicator.  Raises CompilationError if the form cannot be compiled, cached or
    loaded on some rank: a run killed during compilation leaves a file that makes FFCx fail; the error names it.
    """
    result, failure = None, None
    try:
        result = fem.form(form, jit_options={_ARGS: _flags()})
    except Exception as error:  # of the compiler, the system, dolfinx, FFCx or CFFI
        failure = error
    reasons = comm.allgather(failure and f"{type(failure).__name__}: {failure}")
    reason = next(filter(None, reasons), None)
    if result is not None and reason is None:
        return result
    folder = str(jit.get_options()["cache_dir"])
    raise CompilationError(
        f"the kernels of the finite elements cannot be compiled ({reason}): see that there is a C compiler (CC "
        f"says which, if not the system's) and that {folder!r} can be written and has room, or name another folder by "
        "XDG_CACHE_HOME; if an earlier run was killed, remove the file that it has left there"
    ) from failure
