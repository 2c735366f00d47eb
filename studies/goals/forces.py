"""Contact forces: estimated errors against true ones.

    python3 -m studies.goals.forces    # two minutes

Runs that contact alone loads, to several tolerances.  The force of HERTZ-A is known; the others are extrapolated from
the two finest runs of degree 2, as the error of a force falls with the square of that of the energy norm.  It leaves
forces.csv in results/goals.
"""

import argparse
from functools import partial
from pathlib import Path

from fx_contact import adapt, scenes
from fx_contact.results.reference_values import REFERENCES
from studies.tables import plain, write

SCENES = {"hertz": partial(scenes.hertz, order=6, coarse=2), "indentation": scenes.indentation, "punch": scenes.punch}
RUNS = (1, 0.2), (1, 0.1), (2, 0.1), (2, 0.05), (2, 0.03)


def runs(name: str) -> list[dict[str, object]]:
    """Rows of a scene, a run each."""
    rows = []
    for degree, tolerance in RUNS:
        *_, last = (step.record for step in adapt(SCENES[name](), tolerance, degree=degree))
        rows.append(
            {
                "scene": name,
                "degree": degree,
                "tolerance": tolerance,
                "dofs": last.dofs,
                "energy": last.estimate,
                "force": last.force,
                "estimated": last.pair_errors[0],
            }
        )
    known = REFERENCES["hertz-a"]().force if name == "hertz" else extrapolated(*rows[-2:])
    for row in rows:
        true = abs(known / row["force"] - 1)
        row |= {"true": true, "effectivity": row["estimated"] / true}
    return rows


def extrapolated(coarse: dict[str, float], fine: dict[str, float]) -> float:
    """The limit of the force."""
    slope = (coarse["force"] - fine["force"]) / (coarse["energy"] ** 2 - fine["energy"] ** 2)
    return fine["force"] - slope * fine["energy"] ** 2


def main() -> None:
    """All scenes; print the table and keep it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=SCENES, nargs="+", default=list(SCENES), help="scenes (all)")
    parser.add_argument("--output", type=Path, default=Path("results/goals"))
    arguments = parser.parse_args()
    rows = [row for name in arguments.only for row in runs(name)]
    write(arguments.output / "forces.csv", rows)
    print(plain(rows))


if __name__ == "__main__":
    main()
