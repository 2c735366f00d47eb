"""PETSc options under a prefix: defaults that the user's dict replaces, which the command line replaces."""

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

from fx_contact.parallel.agreement import check_alike
from fx_contact.parallel.errors import SceneError


class PetscOptions:
    """The options of one PETSc object.

    Collective on comm.  PETSc takes no notice of case in names: here they are in small letters.

    Args:
        comm: of the ranks that have the object.
        prefix: of the object.
        defaults: the program's options; another `pc_type` of the user replaces all of them.
        given: the user's options.

    Attributes:
        prefix: as given.
        of_user: options that the user has given, as arguments or on the command line, without prefix.

    Raises:
        SceneError: ranks have different options under the prefix on the command line; PETSc would hang.
    """

    def __init__(self, comm: MPI.Comm, prefix: str, defaults: dict[str, Any], given: dict[str, Any]) -> None:
        self._comm, self.prefix = comm, prefix
        typed = {name: value for name, value in _database().items() if name.startswith(prefix)}
        check_alike(comm, {f"PETSc's option -{name}": value for name, value in typed.items()})
        typed = {name.removeprefix(prefix): value for name, value in typed.items()}
        defaults, given = ({name.lower(): value for name, value in some.items()} for some in (defaults, given))
        self.of_user = given | typed
        if self.of_user.get("pc_type", defaults.get("pc_type")) != defaults.get("pc_type"):
            defaults = {}  # of a preconditioner that the user's replaces: PETSc's GAMG refuses those of its MG
        self._ours = {name: value for name, value in (defaults | given).items() if name not in typed}
        self._unread = set(self.of_user)

    def check_free(self, reserved: set[str], advice: str) -> None:
        """Raises SceneError, with advice, if the user gave a reserved option."""
        for name in sorted(reserved & self.of_user.keys()):
            raise SceneError(
                f"the PETSc option {name!r} (on the command line -{self.prefix}{name}) is not the user's: {advice}"
            )

    @contextmanager
    def there(self) -> Iterator[None]:
        """Hold the options in PETSc's database while the block runs, which reads them.  Local."""
        database = PETSc.Options(self.prefix)
        for name, value in self._ours.items():
            database[name] = value
        try:
            yield
            self._unread = {name for name in self._unread if not _is_used(self.prefix + name)}
        finally:
            for name in self._ours:
                database.delValue(name)

    def check_read(self) -> None:
        """Check that the blocks have read all options of the user.

        Collective on comm.

        Raises:
            SceneError: one was not, on any rank: it is misspelt, or useless.
        """
        for name in _unread_anywhere(self._comm, self._unread):
            raise SceneError(
                f"PETSc's solver does not read the option {name!r} (on the command line -{self.prefix}{name}): it is "
                "misspelt, or belongs to another solver or preconditioner; -help lists those that it reads"
            )


def _unread_anywhere(comm: MPI.Comm, unread: set[str]) -> list[str]:
    """Options that no rank has read: solvers inside others are on some."""
    return sorted(set.intersection(*map(set, comm.allgather(sorted(unread)))))


def _database() -> dict[str, str]:
    """All options that PETSc has, by their whole names."""
    return {name.lower(): value for name, value in PETSc.Options().getAll().items()}


def _is_used(name: str) -> bool:
    """Whether an option in the database has been read; petsc4py does not tell, so PETSc itself is asked."""
    used = ctypes.c_int(0)
    ctypes.CDLL(PETSc.__file__).PetscOptionsUsed(None, name.encode(), ctypes.byref(used))
    return bool(used.value)
