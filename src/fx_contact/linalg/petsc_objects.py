"""Objects of PETSc that all ranks free together: on several ranks petsc4py does not free unreferenced ones."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any, TypeVar

from mpi4py import MPI
from petsc4py import PETSc

from fx_contact.parallel.errors import FxContactError, SolveError
from fx_contact.parallel.mpi import together

#: Time that a rank on which PETSc has failed waits for the others, which may hang in PETSc [s].
_TIMEOUT = 10.0

_Thing = TypeVar("_Thing")


class PetscObjects:
    """Objects with `destroy` and `incRef`, freed at the end of a `with` block, also by an error of this package.

    Collective.  Errors of this package are raised on all ranks.  Any other may have come to this rank alone, which must
    not wait for the rest: then nothing is freed.
    """

    def __init__(self, *things: Any) -> None:
        self._things = [thing for thing in things if thing is not None]

    def __enter__(self) -> PetscObjects:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None or issubclass(kind, FxContactError):
            for thing in reversed(self._things):
                thing.destroy()

    def add(self, thing: _Thing) -> _Thing:
        """Register an object and return it.  Local."""
        self._things.append(thing)
        return thing

    def leak(self) -> None:
        """Never free them: after a failure on some ranks, whose objects then differ, freeing would hang.

        Local, but on all ranks.  One reference to each is kept for good, as PETSc cleans up at the end of the program.
        """
        for thing in self._things:
            if thing:  # not destroyed before
                thing.incRef()
        self._things.clear()


@contextmanager
def petsc_errors(comm: MPI.Intracomm, prefix: str, objects: PetscObjects) -> Iterator[None]:
    """Raises SolveError on all ranks for an error of PETSc on any; errors of Python in our callbacks stay as they are.

    Collective on comm.  PETSc may fail on one rank alone: rank 0 opens the files of monitors and views.  After a
    failure the objects are never freed.
    """
    try:
        with together(comm, _TIMEOUT):
            try:
                yield
            except PETSc.Error as error:
                clear_hypre_errors()
                cause: BaseException = error
                while isinstance(cause, PETSc.Error) and cause.__cause__ is not None:
                    cause = cause.__cause__
                if not isinstance(cause, PETSc.Error):
                    raise cause from None
                raise SolveError(
                    f"PETSc cannot work with the solver's options, under the prefix {prefix}, as they are: {cause}"
                ) from error
    except BaseException:
        objects.leak()
        raise


def clear_hypre_errors() -> None:
    """Clear hypre's error flag: it stays after a failure, and every later call would report it.  Local."""
    clear = getattr(ctypes.CDLL(PETSc.__file__), "HYPRE_ClearAllErrors", None)
    if clear is not None:
        clear()
