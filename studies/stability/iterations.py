"""Iterations on one mesh over the ratio of the bodies' stiffnesses and over the penalty, on 1, 2 and 3 ranks.

    python3 -m studies.stability.iterations    # two minutes

A row is a scene on its root cells, solved from zero; ratios by the enforcement that the program chooses, penalties
with bodies of one modulus.  "last": iterations of the last solve, "of all": of all solves, whose number is that of the
active sets.  It leaves iterations.csv in the folder of results.
"""

import json
from dataclasses import replace

from mpi4py import MPI

from fx_contact import Enforcement, Material, adapt, scenes
from studies.runs import by_itself
from studies.stability.cases import exponent
from studies.tables import options, tabulate

RANKS = (1, 2, 3)
RATIOS, FACTORS = [10.0**n for n in range(-6, 7)], [10.0**n for n in range(1, 13)]
#: Scenes of two bodies of the modulus 1, on root cells that are fine enough to solve.
SCENES = {
    "blocks": lambda: scenes.stack([Material(1.0, 0.3)] * 2, 0.01, cells=(8, 8, 8)),
    "spheres": lambda: scenes.hertz(1.0, 0.01, coarse=6),
    "punch": lambda: scenes.punch(displacement=0.01, coarse=8),
}


def solved(scene, **how):
    """Unknowns, iterations of the last solve and of all, and active sets, on the root cells."""
    (step,) = adapt(scene, 0.01, max_steps=1, allow=("large strain",), **how)
    iterations = step.record.krylov_iterations
    return step.record.dofs, iterations[-1], sum(iterations), step.record.contact_iterations


def measured():
    """The rows of this number of ranks.  Collective."""
    rows = []
    for name, make in SCENES.items():
        scene = make()
        first, *others = scene.materials
        over = {
            "stiffness ratio": [
                (replace(scene, materials=scene.materials | dict.fromkeys(others, Material(ratio, 0.3))), {})
                for ratio in RATIOS
            ],
            "penalty": [(scene, {"enforcement": Enforcement("penalty", factor)}) for factor in FACTORS],
        }
        for what, cases in over.items():
            dofs, last, total, sets = zip(*(solved(problem, **how) for problem, how in cases))
            values = RATIOS if what == "stiffness ratio" else FACTORS
            rows.append(
                {
                    "scene": name,
                    "over": what,
                    "from_to": f"{exponent(values[0])} to {exponent(values[-1])}",
                    "ranks": MPI.COMM_WORLD.size,
                    "dofs": dofs[0],
                    "last": _range(last),
                    "of_all": _range(total),
                    "active_sets": _range(sets),
                }
            )
    return rows


def _range(values):
    return f"{min(values)} to {max(values)}"


def main():
    """All numbers of ranks, one after the other."""
    parser = options(__doc__, "stability")
    parser.add_argument("--here", action="store_true", help="on the ranks that this is started on; rows are printed")
    given = parser.parse_args()
    if given.here:
        rows = measured()
        if MPI.COMM_WORLD.rank == 0:
            print(json.dumps(rows))
        return
    rows = [row for ranks in RANKS for row in by_itself("studies.stability.iterations", "--here", ranks=ranks)]
    tabulate(sorted(rows, key=lambda row: (row["over"], row["scene"])), given.output / "iterations.csv")


if __name__ == "__main__":
    main()
