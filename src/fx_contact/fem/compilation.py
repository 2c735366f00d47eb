"""UFL forms compiled, all of them here, so that what goes wrong on one rank is the same typed error on all."""

from dolfinx import fem, jit

from fx_contact.parallel.errors import CompilationError

#: Flags of the C compiler: sums may be reordered, so that loops over basis functions run on vectors.  Time of the
#: stiffness of a cell of degree 2 with -O2, DOLFINx's own, and with these: 390 and 135 microseconds.
_FLAGS = ["-O3", "-fno-math-errno", "-fno-signed-zeros", "-fno-trapping-math", "-fassociative-math"]
_ARGS = "cffi_extra_compile_args"


def _flags():
    """Those flags, and after them what the user's own file of JIT options says instead of DOLFINx's.  Local."""
    given = jit.get_options()[_ARGS]
    return _FLAGS if given == jit.DOLFINX_DEFAULT_JIT_OPTIONS[_ARGS][0] else [*_FLAGS, *given]


def compiled(comm, form):
    """Compile a form, or take it from FFCx's cache.

    Collective on comm.  A run that is killed while it compiles leaves a file in the cache, for which FFCx waits in vain
    (10 s); the error names it.

    Args:
        comm: the user's MPI communicator, of the ranks that have the form's mesh.
        form: of UFL.

    Returns:
        dolfinx.fem.Form.

    Raises:
        CompilationError: it cannot be compiled, kept or loaded on some rank.
    """
    result, reason, failure = None, None, None
    try:
        result = fem.form(form, jit_options={_ARGS: _flags()})
    except Exception as error:  # of the compiler, the system, dolfinx, FFCx or CFFI
        failure, reason = error, f"{type(error).__name__}: {error}"
    reasons = [reason for reason in comm.allgather(reason) if reason is not None]
    if not reasons:
        return result
    folder = str(jit.get_options()["cache_dir"])
    raise CompilationError(
        f"the kernels of the finite elements cannot be compiled ({reasons[0]}): see that there is a C compiler (CC "
        f"says which, if not the system's) and that {folder!r} can be written and has room, or name another folder by "
        "XDG_CACHE_HOME; if an earlier run was killed, remove the file that it has left there"
    ) from failure
