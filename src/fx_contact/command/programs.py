"""Programs, run so that all ranks end when one fails.

Without it the others wait for a rank that ends before its import of this package, or during MPI calls of their own.
mpi4py's runner, `python3 -m mpi4py`, aborts too late: PETSc is finalised before, which is collective.
"""

import runpy
import sys
import traceback
from pathlib import Path

from mpi4py import MPI

from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.meeting import calling, leave


def run_program(path: str, words: list[str]) -> None:
    """Run a program with its arguments, as Python does.

    Collective on the world.

    Raises:
        SceneError: there is no such file.
        SystemExit: the program exits, alike on all ranks.
    """
    if not Path(path).exists():
        raise SceneError(f"there is no program {path!r}, and no command of this name; fx-contact --help lists them")
    sys.argv[:] = [path, *words]
    sys.path[0] = str(Path(path).resolve().parent)
    with calling(MPI.COMM_WORLD, "python3 -m fx_contact"):
        pass  # from now on the end of a rank is announced to the others
    try:
        runpy.run_path(path, run_name="__main__")
    except SystemExit as error:
        if error.code:
            leave(error)
        raise
    except Exception:
        traceback.print_exc()
        MPI.COMM_WORLD.Abort(1)
