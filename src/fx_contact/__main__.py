"""Run a program so that an error on one rank ends all of them: mpirun -n 2 python3 -m fx_contact program.py.

Without, the other ranks would wait for it.  mpi4py's own runner aborts too late: PETSc is shut down before, together
with the others.
"""

import runpy
import sys
import traceback
from pathlib import Path

from mpi4py import MPI


def main():
    """Run the program that the command line names, with the arguments after it, as Python does."""
    del sys.argv[0]
    if not sys.argv:
        sys.exit("usage: python3 -m fx_contact PROGRAM.py [ARGUMENT...]")
    sys.path[0] = str(Path(sys.argv[0]).resolve().parent)
    try:
        runpy.run_path(sys.argv[0], run_name="__main__")
    except Exception:
        traceback.print_exc()
        MPI.COMM_WORLD.Abort(1)


main()
