"""PETSc options under a prefix: defaults that the user's command line may replace, and options that nobody reads."""

import ctypes
import re
from contextlib import contextmanager

from petsc4py import PETSc

from fx_contact.parallel.agreement import check_alike
from fx_contact.parallel.errors import SceneError, SolveError
from fx_contact.parallel.validation import nearest

#: Options that users try most, to find the one that a misspelt name was to be.
COMMON = (
    "ksp_type ksp_monitor ksp_monitor_true_residual ksp_converged_reason "
    "ksp_view ksp_view_singularvalues pc_type pc_hypre_type "
    "pc_factor_mat_solver_type pc_gamg_threshold pc_gamg_type mg_levels_ksp_type mg_levels_pc_type "
    "pc_hypre_boomeramg_strong_threshold pc_hypre_boomeramg_max_iter pc_hypre_boomeramg_coarsen_type "
    "pc_hypre_boomeramg_interp_type pc_hypre_boomeramg_P_max pc_hypre_boomeramg_agg_nl "
    "pc_hypre_boomeramg_numfunctions pc_hypre_boomeramg_relax_type_all pc_hypre_boomeramg_relax_type_down "
    "pc_hypre_boomeramg_relax_type_up pc_hypre_boomeramg_print_statistics pc_hypre_ilu_maxiter pc_hypre_ilu_tol"
).split()
#: Options that PETSc reads only when it sets a preconditioner up: of matrices, and of solvers inside of solvers.
_LATE = re.compile("mat_|pc_mg_|(?!ksp_|pc_).+_(ksp|pc|mat)_")


class PetscOptions:
    """The options of one PETSc object.

    Local, but for `check_read`.  PETSc takes no notice of case in names: here they are in small letters.

    Args:
        comm: MPI communicator of the ranks that have the object; all of them have the same options (`check_typed`).
        prefix: that the object has.
        defaults: dict of the program's options.
        given: dict of the user's options, which win over them; the command line wins over both.
        others: prefixes below this one that belong to other objects, tuple of str.
        covered: option of the user -> the defaults that it is to replace, as PETSc would let them win over it.
    """

    def __init__(self, comm, prefix, defaults, given, others, covered):
        self._comm, self._prefix = comm, prefix
        defaults, given = ({name.lower(): value for name, value in some.items()} for some in (defaults, given))
        self._typed = {
            name.removeprefix(prefix): value for name, value in _typed(prefix).items() if not name.startswith(others)
        }
        self._unread = {*given, *self._typed}
        left_out = {name for option in self._unread & covered.keys() for name in covered[option]}
        self._values = {name: value for name, value in defaults.items() if name not in left_out} | given

    def check_free(self, taken):
        """Raises SceneError if the user gave an option that is not theirs; taken: name -> what to do instead."""
        for name in sorted(self._unread & taken.keys()):
            raise SceneError(
                f"the PETSc option {name!r} (on the command line -{self._prefix}{name}) is not the user's: "
                + taken[name]
            )

    def check_kinds(self, ends, unfit):
        """See that no preconditioner or smoother, be it inside another one, is of a kind that the solver cannot have.

        Args:
            ends: ends of the names of options whose values are such kinds, with commas between them: tuple of str.
            unfit: kind, in small letters -> why it cannot.

        Raises:
            SolveError: an option names one of them.
        """
        for name, value in (self._values | self._typed).items():
            for kind in str(value).split(",") if name.endswith(ends) else ():
                if kind.lower() in unfit:
                    raise SolveError(f"-{self._prefix}{name} {kind} {unfit[kind.lower()]}")

    @contextmanager
    def there(self):
        """The options are in PETSc's database for as long as the block runs, which reads them."""
        database = PETSc.Options(self._prefix)
        ours = [name for name in self._values if not database.hasName(name)]
        unread = {name for name in self._unread if not _is_used(self._prefix + name)}
        for name in ours:
            database[name] = self._values[name]
        try:
            yield
            self._unread = {name for name in unread if not _is_used(self._prefix + name)}
        finally:
            for name in ours:
                database.delValue(name)

    def check_read(self, set_up=True):
        """See that all options of the user were read in the blocks, on some rank: solvers inside others may have few.

        Collective on comm.

        Args:
            set_up: whether one of the blocks has set the preconditioner up; if not, options that only that reads are
                let pass: `mat_...`, `sub_pc_type`, `mg_levels_ksp_type`, ...

        Raises:
            SceneError: one was not: it is misspelt, or useless.
        """
        for name in _unread_anywhere(self._comm, self._unread):
            if not set_up and _LATE.match(name):
                continue
            raise SceneError(
                f"PETSc's solver does not read the option {name!r} (on the command line -{self._prefix}{name}): it is "
                f"misspelt, or belongs to another solver or preconditioner{nearest(name, COMMON)}"
            )


def unread_options(comm, prefix):
    """Options of the command line that no rank has read so far, but for those under a prefix: list of str.

    Collective on comm.
    """
    late = "options_left", "objects_dump"  # PETSc reads them when it ends
    mine = [name for name in _typed() if not name.startswith((prefix, *late)) and not _is_used(name)]
    return _unread_anywhere(comm, mine)


def _unread_anywhere(comm, unread):
    """Those of the options that a rank has not read that no other has: sorted list of str.  Collective on comm."""
    return sorted(set.intersection(*map(set, comm.allgather(sorted(unread)))))


def check_typed(comm, prefix):
    """See that all ranks have the same options under a prefix on the command line.

    Collective on comm.  Ranks with other options than others would wait for each other for ever inside of PETSc.

    Args:
        comm: MPI communicator.
        prefix: of the options.

    Raises:
        SceneError: ranks differ; it says in what.
    """
    check_alike(comm, {f"PETSc's option -{name}": value for name, value in _typed(prefix).items()})


def any_typed(prefix):
    """Whether there is an option under a prefix on the command line.  Local."""
    return bool(_typed(prefix))


def _typed(prefix=""):
    """Options in the database under a prefix: dict of their values by their whole names, in small letters.  Local."""
    options = {name.lower(): value for name, value in PETSc.Options().getAll().items()}
    return {name: value for name, value in options.items() if name.startswith(prefix)}


def _is_used(name):
    """Whether an option in the database has been read; petsc4py does not tell, so PETSc itself is asked."""
    ask = getattr(ctypes.CDLL(PETSc.__file__), "PetscOptionsUsed", None)
    used = ctypes.c_int(0)
    return ask is None or ask(None, name.encode(), ctypes.byref(used)) != 0 or bool(used.value)
