"""PETSc on several ranks: objects, which petsc4py does not free there, errors, and options."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any, TypeVar

from mpi4py import MPI
from petsc4py import PETSc

from fx_contact.parallel.agreement import check_alike
from fx_contact.parallel.errors import FxContactError, SceneError, SolveError
from fx_contact.parallel.mpi import together

#: Waiting time of a rank after a failure of PETSc for the others, which may hang in PETSc [s].
_TIMEOUT = 10.0

_Thing = TypeVar("_Thing")


class PetscObjects:
    """Objects with `destroy` and `incRef`, freed at the end of a `with` block, also by an error of this package.

    Collective.  Errors of this package are raised on all ranks.  Any other error may be raised on this rank alone,
    which must not wait for the others: then nothing is freed.
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


class PetscOptions:
    """The options of one PETSc object: those of the user, and defaults unless the user has another `pc_type`.

    Collective on comm.  PETSc ignores the case of names; here they are in small letters, without prefix.  `of_user` are
    those given and those of the command line.

    Raises:
        SceneError: ranks have different options under the prefix on the command line; PETSc would hang.
    """

    def __init__(self, comm: MPI.Intracomm, prefix: str, defaults: dict[str, Any], given: dict[str, Any]) -> None:
        self.comm, self.prefix = comm, prefix
        database = {name.lower(): value for name, value in PETSc.Options().getAll().items()}
        typed = {name: value for name, value in database.items() if name.startswith(prefix)}
        check_alike(comm, {f"PETSc's option -{name}": value for name, value in typed.items()})
        typed = {name.removeprefix(prefix): value for name, value in typed.items()}
        defaults, given = ({name.lower(): value for name, value in some.items()} for some in (defaults, given))
        self.of_user = given | typed
        if self.of_user.get("pc_type", defaults.get("pc_type")) != defaults.get("pc_type"):
            defaults = {}  # PETSc's GAMG refuses options of its MG
        self._ours = {name: value for name, value in (defaults | given).items() if name not in typed}
        self._unread = set(self.of_user)

    @contextmanager
    def reading(self, objects: PetscObjects) -> Iterator[None]:
        """A block that reads the options, which are in PETSc's database while it runs.

        Collective on comm.  Errors and objects: `petsc_errors`.
        """
        database = PETSc.Options(self.prefix)
        for name, value in self._ours.items():
            database[name] = value
        try:
            with petsc_errors(self.comm, self.prefix, objects):
                yield
            self._unread = {name for name in self._unread if not _is_used(self.prefix + name)}
        finally:
            for name in self._ours:
                database.delValue(name)

    def check_read(self) -> None:
        """Raises SceneError if no rank has read an option of the user; inner solvers are on some ranks only.

        Collective on comm.
        """
        for name in sorted(set.intersection(*map(set, self.comm.allgather(sorted(self._unread))))):
            raise SceneError(
                f"PETSc's solver does not read the option {name!r} (on the command line -{self.prefix}{name}): it is "
                "misspelt, or belongs to another solver or preconditioner; -help lists those that it reads"
            )


def bool_type() -> type[ctypes.c_int] | type[ctypes.c_bool]:
    """C's type of PetscBool, an int or, in newer releases, a bool of one byte: by what PETSc writes.  Local."""
    written = ctypes.create_string_buffer(b"\xff" * ctypes.sizeof(ctypes.c_int), ctypes.sizeof(ctypes.c_int))
    ctypes.CDLL(PETSc.__file__).PetscInitialized(written)
    return ctypes.c_bool if b"\xff" in written.raw else ctypes.c_int


def _is_used(name: str) -> bool:
    """True for an option of the database that has been read, by PETSc's C function, which petsc4py lacks."""
    used = bool_type()()
    ctypes.CDLL(PETSc.__file__).PetscOptionsUsed(None, name.encode(), ctypes.byref(used))
    return bool(used.value)
