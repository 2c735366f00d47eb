"""Compilation of UFL forms and of C functions, with the same typed error on all ranks."""

import ctypes
import os
import shlex
import subprocess
import sysconfig
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

import ufl
from dolfinx import fem, jit
from mpi4py import MPI

from fx_contact.parallel.errors import CompilationError

#: Flags of the C compiler that allow reordered sums, to vectorise loops over basis functions.  The internal
#: forces of a cell of degree 2 take 17 microseconds with -O2, DOLFINx's default, and 9 with these.
_FLAGS = ["-O3", "-fno-math-errno", "-fno-signed-zeros", "-fno-trapping-math", "-fassociative-math"]
#: Extensions of x86 processors, as Linux and compilers call them: all forms of HERTZ-A take 0.6 of the time with them.
_EXTENSIONS = "avx2", "fma"
_ARGS = "cffi_extra_compile_args"
_Thing = TypeVar("_Thing")


def compiled(comm: MPI.Intracomm, form: ufl.Form) -> fem.Form:
    """Compile a form, or take it from FFCx's cache.

    Collective on comm, the user's communicator.  Raises CompilationError if the form cannot be compiled, cached or
    loaded on some rank: a run killed during compilation leaves a file that makes FFCx fail; the error names it.
    """
    return _on_all_ranks(comm, lambda: fem.form(form, jit_options={_ARGS: _flags()}))


def library(comm: MPI.Intracomm, source: str) -> ctypes.CDLL:
    """Functions in C, compiled with the flags of forms, or from a file beside FFCx's.

    Collective on comm, the user's communicator.  Raises CompilationError if they cannot be compiled, kept or loaded on
    some rank.
    """
    return _on_all_ranks(comm, lambda: _loaded(_built(comm, source)))


def _build(source: str) -> Path:
    """The library's file, named by a hash of compiler, flags and source; programs may compile it at the same time."""
    compiler = [*shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc"), *_flags()]
    folder = jit.get_options()["cache_dir"]
    name = sha256(repr((compiler, source)).encode()).hexdigest()
    result: Path = folder / f"libfx_contact_{name}{sysconfig.get_config_var('EXT_SUFFIX')}"  # which names the machine
    if not result.exists():
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=folder) as made:
            code, out = Path(made) / "source.c", Path(made) / "library.so"
            code.write_text(source)
            words = [*compiler, "-shared", "-fPIC", "-o", str(out), str(code)]
            try:
                subprocess.check_output(words, stderr=subprocess.STDOUT, text=True)
            except subprocess.CalledProcessError as error:
                raise RuntimeError(f"{error} {' '.join(error.output.split())}") from error
            out.replace(result)
    return result


_built = jit.mpi_jit_decorator(_build)  # type: ignore[no-untyped-call]  # on rank 0, then on the others
_loaded = cache(ctypes.CDLL)


def _flags() -> list[str]:
    """Flags, followed by those of the user's file of JIT options if it changes DOLFINx's default.

    They are part of the names of compiled files, in a folder that unlike hosts may share.
    """
    given, own = jit.get_options()[_ARGS], [*_FLAGS, *_for_processor()]
    return own if given == jit.DOLFINX_DEFAULT_JIT_OPTIONS[_ARGS][0] else [*own, *given]


@cache
def _for_processor() -> list[str]:
    told = Path("/proc/cpuinfo")
    known = told.read_text().split() if told.exists() else []
    return [f"-m{name}" for name in _EXTENSIONS if name in known]


def _on_all_ranks(comm: MPI.Intracomm, build: Callable[[], _Thing]) -> _Thing:
    """Result of a compilation on each rank, or the same CompilationError on all.  Collective on comm."""
    result, failure = None, None
    try:
        result = build()
    except Exception as error:  # of the compiler, the system, dolfinx, FFCx or CFFI
        failure = error
    reasons = comm.allgather(failure and f"{type(failure).__name__}: {failure}")
    reason = next(filter(None, reasons), None)
    if result is not None and reason is None:
        return result
    folder = str(jit.get_options()["cache_dir"])
    raise CompilationError(
        f"kernels in C cannot be compiled ({reason}): see that there is a C compiler (CC says which, if not the "
        f"system's) and that {folder!r} can be written, has room and is not mounted noexec, or name another folder by "
        "XDG_CACHE_HOME; if FFCx waits for what a killed run has left there, remove the file"
    ) from failure
