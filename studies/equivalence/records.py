"""Records of reference runs, to see that a change of the code changes no result.

    mpirun -n 2 python3 studies/equivalence/records.py before.json     # with the code as it was
    mpirun -n 2 python3 studies/equivalence/records.py after.json      # with the code as it is
    python3 studies/equivalence/compare.py before.json after.json

Displacements have degree 1.  Each adaptive step leaves its cells, leaves by level, unknowns, active pairs, contact
iterations, and the forces of its contact pairs.  `--quick` runs a quarter of the cases, `--only WORD` those whose name
has the word.
"""

import argparse
import json
import runpy
import sys
import time
from pathlib import Path

import numpy as np
from mpi4py import MPI

from fx_contact import Enforcement, adapt, solve
from fx_contact.scenes import cylinders, hertz, indentation, patch, punch, shrink_fit, spheres, stack

#: What must stay as it is, to rounding.
KEPT = ("cells", "dofs", "hanging_nodes", "max_level", "geometry_order", "active_pairs", "contact_iterations")
ROUNDED = ("estimate", "assumed_effectivity", "force", "contact_radius", "max_pressure")
METHODS = ("exact", "penalty")
PARTITIONS = ("contact-sfc", "equidistributed", "sfc", "graph")


def cases():
    """Name -> (scene, tolerance, further arguments of `adapt`), cheap ones first."""
    quick = {}
    for order in (1, 3, 6):
        quick[f"hertz quarter order {order} 16 %"] = lambda o=order: (hertz(order=o), 0.16, {})
    for method in METHODS:
        quick[f"hertz {method} 16 %"] = lambda m=method: (hertz(), 0.16, {"enforcement": Enforcement(m)})
    for kind in PARTITIONS:
        quick[f"hertz {kind} 16 %"] = lambda k=kind: (hertz(), 0.16, {"partition_kind": k})
    for name, make in (("spheres", spheres), ("punch", punch), ("cylinders", cylinders), ("shrink fit", shrink_fit)):
        quick[f"{name} 15 %"] = lambda m=make: (m(), 0.15, {})
    quick["stack 10 %"] = lambda: (stack(), 0.10, {})
    quick["patch 4 %"] = lambda: (patch(), 0.04, {})
    long = {}
    for order in (1, 3, 6):
        for tolerance in (0.16, 0.08):
            name = f"hertz full order {order} {tolerance:.0%}"
            long[name] = lambda o=order, t=tolerance: (hertz(order=o, symmetry="full"), t, {})
        for tolerance in (0.08, 0.04):
            long[f"hertz quarter order {order} {tolerance:.0%}"] = lambda o=order, t=tolerance: (
                hertz(order=o),
                t,
                {},
            )
    for method in METHODS:
        long[f"indentation {method} 8 %"] = lambda m=method: (indentation(), 0.08, {"enforcement": Enforcement(m)})
    for kind in PARTITIONS:
        long[f"hertz {kind} 8 %"] = lambda k=kind: (hertz(), 0.08, {"partition_kind": k})
    long["spheres 8 %"] = lambda: (spheres(), 0.08, {})
    return quick, long


def kept(step):
    """What a step leaves: dict.  Collective."""
    record = step.record
    levels = np.zeros(16, dtype=np.int64)
    np.add.at(levels, step.forest.level, 1)
    levels = step.forest.comm.allreduce(levels)
    names = (*KEPT, *ROUNDED, "pair_forces", "krylov_iterations")
    return {name: getattr(record, name) for name in names} | {"levels": levels.tolist()}


def as_text(result):
    """The records as JSON, one line a step."""
    runs = (f"{json.dumps(name)}: [\n" + ",\n".join(map(json.dumps, steps)) + "\n]" for name, steps in result.items())
    return "{\n" + ",\n".join(runs) + "\n}\n"


def main():
    """Run the cases, and write what they leave."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("file", type=Path)
    options.add_argument("--quick", action="store_true")
    options.add_argument("--only", default="")
    arguments, comm, result = options.parse_args(), MPI.COMM_WORLD, {}
    quick, long = cases()
    for name, make in (quick if arguments.quick else {**quick, **long}).items():
        if arguments.only not in name:
            continue
        start = time.process_time()
        scene, tolerance, others = make()
        result[name] = [kept(step) for step in adapt(scene, tolerance, comm, degree=1, **others)]
        seconds = comm.allreduce(time.process_time() - start)
        if comm.rank == 0:
            print(f"{name}: {len(result[name])} steps, {result[name][-1]['dofs']} dofs, {seconds:.1f} s", flush=True)
    if arguments.only in "own_gmsh_model":
        demos = Path(__file__).parents[2] / "demos"
        sys.path.insert(0, str(demos))
        scene = runpy.run_path(str(demos / "own_gmsh_model.py"))["scene"]
        result["own_gmsh_model"] = [kept(solve(scene, 0.1, comm, degree=1))]
    if comm.rank == 0:
        arguments.file.write_text(as_text(result))


if __name__ == "__main__":
    main()
