"""Forms of UFL compiled, all of them here: what compiler, cache folder or a killed run do wrong is told on all ranks.

FFCx begins with an empty file of the form's name in the cache folder, at which others see that it is being compiled,
and ends with a mark beside it.  Who is killed in between leaves the file without the mark, and all who need the form
wait for it in vain.  So runs of this package hold a shared lock, which goes with the process, while they compile: who
has waited for FFCx's time limit and then gets the lock alone waits for nobody, and removes the file.
"""

import fcntl
import re
from contextlib import contextmanager

from dolfinx import fem, jit

from fx_contact.parallel.errors import CompilationError

#: How often to wait for another run that compiles the same form, for FFCx's time limit (10 s) each time.
_ATTEMPTS = 6


def compiled(comm, form):
    """Compile a form, or take it from the cache.

    Collective on comm.

    Args:
        comm: the user's MPI communicator, of the ranks that have the form's mesh.
        form: of UFL.

    Returns:
        dolfinx.fem.Form.

    Raises:
        CompilationError: it cannot be compiled, kept or loaded on some rank.
    """
    for _ in range(_ATTEMPTS):
        result, reason, failure = None, None, None
        try:
            with _lock(fcntl.LOCK_SH):
                result = fem.form(form)
        except Exception as error:  # of the compiler, the system, dolfinx, FFCx or CFFI
            failure, reason = error, f"{type(error).__name__}: {error}"
        reasons = [reason for reason in comm.allgather(reason) if reason is not None]
        if not reasons:
            return result
        if not any(map(_waited_for, reasons)):
            break
        if reason is not None and (name := _waited_for(reason)):
            _remove_left(name)
        comm.Barrier()  # no rank takes the lock again before
    raise CompilationError(
        f"the kernels of the finite elements cannot be compiled ({reasons[0]}): see that there is a C compiler (CC "
        f"says which, if not the system's) and that {str(_cache())!r} can be written and has room, or name another "
        "folder by XDG_CACHE_HOME; if it still fails, remove what is in that folder: all of it is made anew"
    ) from failure


def _cache():
    """The folder of what was compiled.  Local."""
    return jit.get_options()["cache_dir"]


@contextmanager
def _lock(kind):
    """Hold the lock of the cache folder in some way, and tell whether it is; where there can be none, go on.  Local."""
    try:
        _cache().mkdir(parents=True, exist_ok=True)
        file = (_cache() / "fx_contact.lock").open("a")
    except OSError:
        yield False
        return
    with file:
        try:
            fcntl.flock(file, kind)
            held = True
        except OSError:
            held = False
        yield held


def _waited_for(reason):
    """Name of the form that FFCx has waited for in vain; None where something else is the reason.  Local."""
    name = re.search(r"libffcx_\w+(?=\.c\b)", reason)
    return name[0] if name and "timed out" in reason else None


def _remove_left(name):
    """Remove what a killed run has left of a form, unless a run that lives may be at it.  Local."""
    with _lock(fcntl.LOCK_EX | fcntl.LOCK_NB) as alone:
        left = _cache() / f"{name}.c"
        if alone and not left.with_suffix(".c.cached").exists():
            left.unlink(missing_ok=True)
