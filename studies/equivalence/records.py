"""Records of reference runs at both degrees, to see that a change of the code changes no result.

    mpirun -n 2 python3 studies/equivalence/records.py after.json    # --only WORD: the runs whose name has it
    python3 studies/equivalence/compare.py before.json after.json

Three minutes on two idle cores; `--long` runs three accurate ones instead.
"""

import argparse
import json
import time
from functools import partial
from pathlib import Path

import numpy as np
from mpi4py import MPI

from fx_contact import Enforcement, ErrorControl, Material, adapt
from fx_contact.scenes import cylinders, hertz, indentation, patch, punch, shrink_fit, spheres, stack

#: Entries of a record that are kept: to the last digit, and to rounding.
EXACT = ("cells", "dofs", "hanging_nodes", "max_level", "geometry_order", "active_pairs", "contact_iterations")
ROUNDED = ("estimate", "assumed_effectivity", "force", "contact_radius", "max_pressure", "max_penetration")
OTHERS = ("pair_forces", "pair_errors", "krylov_iterations")


def cases(long):
    """Name -> (scene, tolerance, further arguments of `adapt`)."""
    if long:
        return {
            "hertz 1 % degree 2": (hertz, 0.01, {}),
            "indentation 3 % degree 2": (indentation, 0.03, {}),
            "hertz 8 % degree 1": (hertz, 0.08, {"degree": 1}),
        }
    found = {"hertz rubber degree 2": (partial(hertz, material=Material(1.0, 0.49)), 0.08, {})}
    for degree, close, wide in ((1, 0.16, 0.15), (2, 0.05, 0.06)):
        runs = {
            "hertz": (hertz, close, {}),
            "hertz order 1": (partial(hertz, order=1), close, {}),
            "hertz penalty": (hertz, close, {"enforcement": Enforcement("penalty", factor=1e5)}),
            "hertz energy": (hertz, close, {"control": ErrorControl("energy")}),
            "hertz sfc": (hertz, close, {"partition_kind": "sfc"}),
            **{make.__name__: (make, wide, {}) for make in (spheres, punch, cylinders, shrink_fit)},
            "stack": (stack, 0.10, {}),
            "patch": (patch, 0.04, {}),
            "indentation": (indentation, 0.2 / degree, {}),
        }
        for name, (make, tolerance, how) in runs.items():
            found[f"{name} degree {degree}"] = make, tolerance, how | {"degree": degree}
    return found


def kept(step):
    """Entries of the record of a step, and its leaves by level: dict.  Collective."""
    levels = np.bincount(step.forest.level, minlength=16)
    levels = step.forest.comm.allreduce(levels)
    return {n: getattr(step.record, n) for n in (*EXACT, *ROUNDED, *OTHERS)} | {"levels": levels.tolist()}


def main():
    """Run the cases, and write what they leave."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("file", type=Path)
    options.add_argument("--only", default="", metavar="WORD")
    options.add_argument("--long", action="store_true")
    arguments, comm, result = options.parse_args(), MPI.COMM_WORLD, {}
    for name, (make, tolerance, how) in cases(arguments.long).items():
        if arguments.only in name:
            start = time.process_time()
            result[name] = [kept(step) for step in adapt(make(), tolerance, comm, **how)]
            seconds = comm.allreduce(time.process_time() - start)
            if comm.rank == 0:
                print(f"{name}: {len(result[name])} steps, {seconds:.1f} s", flush=True)
    if comm.rank == 0:
        arguments.file.write_text(json.dumps(result))


if __name__ == "__main__":
    main()
