"""Contact forces: estimated errors against true ones.

    python3 -m studies.goals.forces    # two minutes

Runs that contact alone loads, to several tolerances.  The force of HERTZ-A is known; the others are extrapolated from
the two finest runs of degree 2, as the error of a force falls with the square of that of the energy norm.  It leaves
forces.csv in results/goals.
"""

from functools import partial

from demos.hertz_reference import REFERENCES
from fx_contact import adapt, scenes
from studies.tables import options, tabulate

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
    parser = options(__doc__, "goals")
    parser.add_argument("--only", choices=SCENES, nargs="+", default=list(SCENES), help="scenes (all)")
    given = parser.parse_args()
    tabulate((row for name in given.only for row in runs(name)), given.output / "forces.csv")


if __name__ == "__main__":
    main()
