"""Error of friction by the number of load steps, and its warning "load step".

    ./with-dolfinx python3 -m studies.goals.load_steps    # a minute

Half of a ball is pressed on a rigid plane in equal load steps, all on one mesh.
"""

from dataclasses import replace

from fx_contact import Beginning, Dirichlet, adapt, increments
from studies.cost.friction import MODEL, scene
from studies.tables import options, tabulate

#: Coefficients of friction, and numbers of load steps.
COEFFICIENTS, STEPS = (0.3, 1.0), (1, 2, 4, 8, 16)


def pressed(part, mu):
    """The scene with a part of the load."""
    whole = scene(0.0, mu, 0.3)
    return replace(whole, dirichlet=(Dirichlet("ball z = 0", 0.0, 0.0, -0.01 * part), *whole.dirichlet[1:]))


def measured():
    """Rows of the table; forces relative to that of most steps."""
    forest = adapt(scene(0.0, 0.0, 0.3), 0.05, **MODEL).last_step().forest
    how = {"beginning": Beginning.at_rest(forest), "max_steps": 1} | MODEL
    for mu in COEFFICIENTS:
        rows = []
        for steps in STEPS:
            parts = [(step + 1) / steps for step in range(steps)]
            record = list(increments(lambda part: pressed(part, mu), parts, 0.05, **how))[-1].record.record
            warned = [doubt.value for doubt in record.doubts if doubt.kind == "load step"]
            sticks = record.sticking_pairs / record.active_pairs
            rows.append(
                {
                    "mu": mu,
                    "steps": steps,
                    "force": record.force,
                    "sticks": sticks,
                    "warned": warned[0] if warned else "",
                }
            )
        for row in rows:
            yield row | {"force": row["force"] / rows[-1]["force"] - 1}


def main():
    """Measure; print the table and keep it."""
    given = options(__doc__, "goals").parse_args()
    tabulate(measured(), given.output / "load_steps.csv")


if __name__ == "__main__":
    main()
