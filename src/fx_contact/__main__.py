"""Runner that ends all ranks when one fails: mpirun -n 2 python3 -m fx_contact program.py.

Without it the others wait for a rank that ends before its import of this package, or during MPI calls of their own.
mpi4py's runner, `python3 -m mpi4py`, aborts too late: PETSc is finalised before, which is collective.
"""

import runpy
import sys
import traceback
from pathlib import Path

from mpi4py import MPI

from fx_contact.parallel.meeting import calling, leave


def main() -> None:
    """Run the program named on the command line with its arguments, as Python does.

    Raises:
        SystemExit: no program is named; or the program exits, alike on all ranks.
    """
    del sys.argv[0]
    if not sys.argv:
        sys.exit("usage: python3 -m fx_contact PROGRAM.py [ARGUMENT...]")
    sys.path[0] = str(Path(sys.argv[0]).resolve().parent)
    with calling(MPI.COMM_WORLD, "python3 -m fx_contact"):
        pass  # from now on the end of a rank is announced to the others
    try:
        runpy.run_path(sys.argv[0], run_name="__main__")
    except SystemExit as error:
        if error.code:
            leave(error)
        raise
    except Exception:
        traceback.print_exc()
        MPI.COMM_WORLD.Abort(1)


main()
