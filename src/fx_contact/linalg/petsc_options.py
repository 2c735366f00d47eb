"""PETSc options under a prefix: defaults that the user's dict replaces, which the command line replaces."""

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

from fx_contact.linalg.petsc_objects import PetscObjects, petsc_errors
from fx_contact.parallel.agreement import check_alike
from fx_contact.parallel.errors import SceneError


class PetscOptions:
    """The options of one PETSc object.

    Collective on comm.  PETSc ignores the case of names; here they are in small letters.

    Args:
        defaults: the program's options; another `pc_type` of the user replaces all of them.
        given: the user's options.

    Attributes:
        of_user: options given by the user, as arguments or on the command line, without prefix.

    Raises:
        SceneError: ranks have different options under the prefix on the command line; PETSc would hang.
    """

    def __init__(self, comm: MPI.Intracomm, prefix: str, defaults: dict[str, Any], given: dict[str, Any]) -> None:
        self._comm, self.prefix = comm, prefix
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
            with petsc_errors(self._comm, self.prefix, objects):
                yield
            self._unread = {name for name in self._unread if not _is_used(self.prefix + name)}
        finally:
            for name in self._ours:
                database.delValue(name)

    def check_read(self) -> None:
        """See that all options of the user have been read.

        Collective on comm.

        Raises:
            SceneError: one has not been read on any rank: solvers inside others are on some.
        """
        for name in sorted(set.intersection(*map(set, self._comm.allgather(sorted(self._unread))))):
            raise SceneError(
                f"PETSc's solver does not read the option {name!r} (on the command line -{self.prefix}{name}): it is "
                "misspelt, or belongs to another solver or preconditioner; -help lists those that it reads"
            )


def _is_used(name: str) -> bool:
    """True for an option of the database that has been read, by PETSc's C function, which petsc4py lacks."""
    used = ctypes.c_int(0)
    ctypes.CDLL(PETSc.__file__).PetscOptionsUsed(None, name.encode(), ctypes.byref(used))
    return bool(used.value)
