"""What each rule of contact's error control is for: the scenes that go wrong without it, and what it costs.

    python3 -m studies.stability.without            # half an hour on two cores
    python3 -m studies.stability.without --rule forces --axis "between nodes"
    python3 -m studies.stability.without --together forces "effectivity of first meshes"

Each rule is switched off, the others as they are, on the scenes of the stress matrix that take less than `SECONDS` with
all rules.  The twins that they are compared with have all rules.  Scenes are left out that are compared with themselves
in other units or another direction, whose errors are the same with any rules.  It leaves
without.csv in the folder of results.
"""

import os
from contextlib import ExitStack, contextmanager
from functools import partial
from multiprocessing import get_context
from unittest import mock

import numpy as np

from fx_contact.adaptive import step_solver
from fx_contact.estimate.error_control import ErrorControl
from fx_contact.estimate.inter_node_gap import GapBetweenNodes
from studies.stability.run import score
from studies.stability.scenes import cases
from studies.tables import TOP, options, read, tabulate

#: Scenes are tried that take less than so many CPU seconds with all rules, by the scores that are kept.
SECONDS, SCORES = 20.0, TOP / "studies/stability/scores.csv"


def _none(between, *_):
    """No leaf of a GapBetweenNodes: (n,) bool."""
    return np.zeros(len(between._forest), dtype=bool)


def _no_gap(between):
    """No gap on the cells of a GapBetweenNodes: (ncells,) float64."""
    return np.zeros(len(between._leaf))


#: What is put in the place of a rule, by its name: object, attribute, replacement.
RULES = {
    "forces": (step_solver, "force_goals", lambda *_: {}),
    "gap between nodes in a force": (GapBetweenNodes, "on_cells", lambda between, _: _no_gap(between)),
    "penetration between nodes": (GapBetweenNodes, "penetrated", _none),
    "effectivity of first meshes": (ErrorControl, "effectivity", lambda *_: 1.0),
}


@contextmanager
def switched_off(rules):
    """The replacements of rules in their places."""
    with ExitStack() as stack:
        for rule in rules:
            stack.enter_context(mock.patch.object(*RULES[rule]))
        yield


def scored(name, rules):
    """The score of a scene that is solved with some rules switched off; its twin has them all."""
    try:
        return score(cases()[name], switched_off(rules))
    except Exception as error:
        return {"name": name, "score": "crash", "message": repr(error), "cpu_seconds": 0.0}


def tried(name, rule_sets):
    """The scores of a scene with all rules, then without each of some sets: in one process, which keeps the twin."""
    return [scored(name, rules) for rules in ([], *rule_sets)]


def compared(base, found):
    """What is worse than with all rules, and unknowns and CPU seconds relative to those with all: dict."""
    worse = [one["name"] for before, one in zip(base, found) if before["score"] != one["score"] != "right"]
    both = [pair for pair in zip(base, found) if all("dofs" in one for one in pair)]

    def ratio(key):
        return sum(one[key] for _, one in both) / sum(before[key] for before, _ in both)

    row = {"scenes": len(base), "worse": len(worse), "unknowns": ratio("dofs"), "cpu": ratio("own_cpu_seconds")}
    return row | {"which": ", ".join(worse)}


def chosen(axes):
    """Names of the scenes of some axes of the matrix, None: of all."""
    _, kept = read(SCORES)
    short = {row["name"] for row in kept if float(row["cpu_seconds"]) < SECONDS}
    named = {name: case for name, case in cases().items() if not axes or case.axis in axes}
    return [name for name, case in named.items() if name in short and not getattr(case.reference, "same_mesh", False)]


def main():
    """Run what is asked for."""
    parser = options(__doc__, "stability")
    parser.add_argument("--rule", choices=RULES, nargs="+", default=list(RULES), help="each (all)")
    parser.add_argument("--together", choices=RULES, nargs="+", help="switch these off at once")
    parser.add_argument("--axis", nargs="+", help="rows of the matrix (all)")
    given = parser.parse_args()
    rule_sets = [given.together] if given.together else [[rule] for rule in given.rule]
    with get_context("spawn").Pool(len(os.sched_getaffinity(0))) as pool:
        names = chosen(given.axis)
        base, *found = zip(*pool.map(partial(tried, rule_sets=rule_sets), names, chunksize=1))
    rows = ({"without": ", ".join(rules)} | compared(base, one) for rules, one in zip(rule_sets, found))
    tabulate(rows, given.output / "without.csv")


if __name__ == "__main__":
    main()
