"""Where the time goes, and how it grows: CPU seconds and memory of the demos.

Runs the demos as anyone would, one command after the other, and reads their records. What has run before is not run
again: after a change of the program, name another folder. Targets were set for degree 1, that of all other studies.
CPU seconds are those of all ranks and all steps, without compilation, start of Python and root mesh; memory is the
largest resident size of all ranks together.

    python3 -m studies.cost.run                  # the pages' table, without the large runs
    python3 -m studies.cost.run --large          # with them: 15 minutes, 16 GB
    python3 -m studies.cost.run --study hertz orders growth ranks python

Each study leaves a table, STUDY.csv, in results/cost, and prints it.
"""

import os
import sys

import numpy as np

from studies.runs import STAGES, Case, RunFailed, cpu, records, run, wall
from studies.tables import options, tabulate

#: The pages' table: targets in CPU seconds and kB a dof, where there are some.
STANDARD = {
    Case("indentation", "--degree 1 --symmetry full --tolerance 0.06"): (87, 3.0),
    Case("hertz", "--degree 1 --symmetry full --tolerance 0.08"): (25, 3.2),
    Case("hertz", "--degree 1 --symmetry full --tolerance 0.04"): (230, 3.2),
    Case("hertz", "--degree 1 --tolerance 0.08"): (25 / 4, None),
    Case("hertz", "--degree 1 --tolerance 0.04"): (230 / 4, None),
    Case("hertz", "--tolerance 0.01"): (None, None),
    Case("indentation", "--tolerance 0.02"): (None, None),
}
LARGE = {
    Case("hertz", "--tolerance 0.003"): (None, None),
    Case("hertz", "--tolerance 0.0014"): (None, None),
    Case("hertz", "--tolerance 0.0007"): (None, None),
    Case("indentation", "--degree 1 --symmetry full --tolerance 0.04"): (None, None),
    Case("hertz", "--degree 1 --tolerance 0.02"): (None, None),
    Case("hertz", "--degree 1 --tolerance 0.014"): (None, None),
}
#: Targets in CPU seconds for a million dofs of degree 1: affine cells, and curved ones.
RATE = {"indentation": 70, "hertz": 120}
ACCURACY = [
    Case("hertz", f"--degree 1 --reference hertz-a {options}")
    for options in ("--tolerance 0.16", "--tolerance 0.08", "--tolerance 0.04", "--order 6", "--symmetry full")
]
ORDERS = [
    Case("hertz", f"--degree 1 --order 6 --geometry-order {order} {name} --tolerance 0.08", ranks)
    for order in (1, 2, 3, 6)
    for name in ("--preconditioner boomeramg", "--preconditioner ilu", "-fx_pc_type gamg")
    for ranks in (1, 2)
]
CHOSEN = Case("hertz", "--degree 1 --order 6 --tolerance 0.08")
AFFINE = ORDERS[1]
GROWTH = [
    Case("indentation", "--degree 1 --symmetry full --tolerance 0.06"),
    Case("hertz", "--degree 1 --tolerance 0.04"),
]
#: Of HERTZ-A at degree 2, for `ranks`, and runs of each.
TOLERANCES, REPEATS = (0.3, 0.08, 0.02, 0.01, 0.005, 0.0025), 3
#: Unknowns of the steps whose time for an unknown is compared with the last one's.
SIZES = 37_000, 100_000


def standard(folder, large):
    """CPU seconds, wall seconds and memory of the standard runs."""
    for case, (seconds, memory) in (STANDARD | (LARGE if large else {})).items():
        steps = records(case, folder)
        dofs = steps[-1]["dofs"]
        yield {
            "command": case.command,
            "dofs": dofs,
            "steps": len(steps),
            "cpu_s": cpu(steps),
            "target_cpu_s": seconds,
            "wall_s": wall(steps),
            "cpu_s_per_million_dofs": 1e6 * cpu(steps) / dofs,
            "target_rate": RATE[case.demo] if "--degree 1" in case.options else None,
            "kB_per_dof": steps[-1]["peak_memory_bytes"] / dofs / 1e3,
            "target_kB": memory,
        }


def hertz(folder, _large):
    """Deviations of force, largest pressure and contact radius from an independent reference."""
    for case in ACCURACY:
        steps = records(case, folder)
        last = steps[-1]
        errors = {name: last["errors"][name] for name in ("force", "max_pressure", "contact_radius")}
        yield {"command": case.command, "cells": last["cells"], "dofs": last["dofs"], **errors, "wall_s": wall(steps)}


def orders(folder, _large):
    """Geometry order, preconditioner and ranks, for one root mesh of order 6: CPU seconds by stage, and memory."""
    affine = records(AFFINE, folder)
    for case in [*ORDERS, CHOSEN]:
        steps, words = records(case, folder), case.options.split()
        given, last = dict(zip(words[::2], words[1::2])), steps[-1]
        memory = last["peak_memory_bytes"]
        yield {
            "geometry_order": given.get("--geometry-order", f"chosen: {last['geometry_order']}"),
            "preconditioner": given.get("-fx_pc_type") or given.get("--preconditioner", "boomeramg"),
            "ranks": case.ranks,
            "dofs": last["dofs"],
            "cpu_s": cpu(steps),
            **{f"{name}_s": cpu(steps, [name]) for name in STAGES},
            "krylov_iterations_last_step": sum(last["krylov_iterations"]),
            "memory_GB": memory / 1e9,
            "cpu_over_order_1": cpu(steps) / cpu(affine),
            "memory_over_order_1": memory / affine[-1]["peak_memory_bytes"],
        }


def ranks(folder, _large):
    """Seconds of whole processes on one and on two ranks by the size of the problem: medians of alternating runs."""
    for tolerance in TOLERANCES:
        cases = [Case("hertz", f"--tolerance {tolerance}", count) for count in (1, 2)]
        seconds, steps = np.zeros((REPEATS, 2, 2)), []
        for repeat in range(REPEATS):
            for column, case in enumerate(cases):
                before = os.times()
                steps, wall_s = run(case, folder / case.name, extra="--records-only")
                after = os.times()
                used = after.children_user + after.children_system - before.children_user - before.children_system
                seconds[repeat, column] = wall_s, used
        (wall_1, cpu_1), (wall_2, cpu_2) = np.median(seconds, axis=0)
        yield {
            "options": cases[0].options,
            "dofs": steps[-1]["dofs"],
            "wall_1_s": wall_1,
            "wall_2_s": wall_2,
            "cpu_1_s": cpu_1,
            "cpu_2_s": cpu_2,
            "speed_up": wall_1 / wall_2,
        }


def growth(folder, large):
    """CPU seconds and memory of a step against its unknowns: slopes in the logarithms."""
    for case in [*GROWTH, *(LARGE if large else {})]:
        steps = records(case, folder)
        dofs = np.array([step["dofs"] for step in steps])
        seconds = np.array([cpu([step]) for step in steps])
        memory = np.array([step["peak_memory_bytes"] for step in steps])
        big = dofs >= 1e4
        slopes = [np.polyfit(np.log(dofs[big]), np.log(y[big]), 1)[0] for y in (seconds, memory)]
        rate = seconds / dofs
        at = {
            f"rate_over_that_at_{size:g}": np.interp(np.log(size), np.log(dofs), rate, np.nan, np.nan)
            for size in SIZES
        }
        yield {
            "command": case.command,
            "dofs": int(dofs[-1]),
            "slope_of_cpu": slopes[0],
            "slope_of_memory": slopes[1],
            **{name: rate[-1] / then for name, then in at.items()},
        }


def python(folder, _large):
    """Python's own share, from above: no step has more of it than the smallest mesh's takes in all.

    Nothing in the package loops over cells or nodes in Python, so that its share of a step does not grow with the mesh.
    """
    for case in GROWTH:
        each = [cpu([step]) for step in records(case, folder)]
        least = min(each)
        yield {
            "command": case.command,
            "cpu_s": sum(each),
            "share_at_most": least * len(each) / sum(each),
            "of_the_last_step": least / each[-1],
        }


STUDIES = {study.__name__: study for study in (standard, hertz, orders, growth, ranks, python)}


def main():
    """Run what is asked for; a table each, printed and kept. Ends with 1 and a sentence if a run failed."""
    parser = options(__doc__, "cost")
    parser.add_argument("--study", choices=STUDIES, nargs="+", default=["standard"], help="(%(default)s)")
    parser.add_argument("--large", action="store_true", help="include the runs that take minutes and up to 16 GB")
    given = parser.parse_args()
    try:
        for name in given.study:
            tabulate(STUDIES[name](given.output, given.large), given.output / f"{name}.csv")
    except OSError as error:
        parser.error(f"cannot write to {str(given.output)!r}: {error.strerror}")
    except RunFailed as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
