"""What each rule of contact's error control is for: the scenes that go wrong without it, and what it costs.

    python3 -m studies.stability.without            # ten minutes on two cores
    python3 -m studies.stability.without --rule gaps --axis "between nodes"

Each rule is switched off, the others as they are, on the axes where contact is light, hidden or beside other loads.
It leaves without.csv in the folder of results.
"""

import argparse
import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from fx_contact.contact.enforcement import METHODS
from fx_contact.estimate import contact_goals
from fx_contact.estimate.error_control import ErrorControl
from fx_contact.estimate.inter_node_gap import GapBetweenNodes
from studies.stability.run import score
from studies.stability.scenes import cases
from studies.tables import TOP, read, write

#: Axes that are tried, and of these the scenes that take less than so many CPU seconds with all rules.
AXES, SECONDS, SCORES = ("other loads", "between nodes"), 20.0, TOP / "studies/stability/scores.csv"


def _none(between, *_):
    """No leaf of a GapBetweenNodes: (n,) bool."""
    return np.zeros(len(between._state.forest), dtype=bool)


#: What is put in the place of a rule, by its name: object, attribute, replacement.
RULES = {
    "none": (),
    "forces": (contact_goals, "allowed_errors", lambda forces, *_: np.full(len(forces), np.inf)),
    "bound of a force": (contact_goals, "_bound", lambda *_: np.inf),
    "gap between nodes in a force": (GapBetweenNodes, "on_cells", lambda *_: 0.0),
    "gaps": (contact_goals, "nearest_place", lambda *_: None),
    "penetration of open facets": (GapBetweenNodes, "penetrated", _none),
    "gap of closed facets": (GapBetweenNodes, "worst", _none),
    "effectivity": (ErrorControl, "correction", lambda *_: 1.0),
}


def switch_off(rule):
    """Put the replacement of a rule in its place, in this process."""
    if RULES[rule]:
        setattr(*RULES[rule])


def scored(name):
    """The score of a scene."""
    try:
        return score(cases(METHODS)[name])
    except Exception as error:
        return {"name": name, "score": "crash", "message": repr(error), "cpu_seconds": 0.0}


def main():
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rule", choices=[*RULES][1:], action="append", help="switch off this one alone")
    parser.add_argument("--axis", action="append", help=f"of the matrix ({', '.join(AXES)})")
    parser.add_argument("--output", type=Path, default=Path("results/stability"), help="folder (%(default)s)")
    arguments = parser.parse_args()
    _, kept = read(SCORES)
    axes, short = arguments.axis or AXES, {row["name"] for row in kept if float(row["cpu_seconds"]) < SECONDS}
    names = [name for name, case in cases(METHODS).items() if case.axis in axes and name in short]
    found, rows = {}, []
    for rule in ("none", *(arguments.rule or [*RULES][1:])):
        workers = {"mp_context": get_context("spawn"), "initializer": switch_off, "initargs": (rule,)}
        with ProcessPoolExecutor(len(os.sched_getaffinity(0)), **workers) as pool:
            found[rule] = list(pool.map(scored, names))
        pairs = list(zip(found["none"], found[rule]))
        worse = [one["name"] for base, one in pairs if base["score"] != one["score"] != "right"]
        both = [(base, one) for base, one in pairs if "dofs" in base and "dofs" in one]
        unknowns, seconds = (
            sum(one[key] for _, one in both) / sum(base[key] for base, _ in both) for key in ("dofs", "cpu_seconds")
        )
        row = {"without": rule, "scenes": len(names), "worse": len(worse), "unknowns": unknowns, "cpu": seconds}
        rows.append(row | {"which": ", ".join(worse)})
        print(row, *worse, sep="\n    ", flush=True)
    arguments.output.mkdir(parents=True, exist_ok=True)
    write(arguments.output / "without.csv", rows, "python3 -m studies.stability.without")


if __name__ == "__main__":
    main()
