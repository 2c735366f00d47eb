"""What a load path costs beside its last point alone: Hertz, approaches from 1e-2 to 1e-5, degree 2.

    python3 -m studies.cost.sweeps    # two minutes

It leaves sweeps.csv in results/cost: CPU seconds without compilation, the median of three runs.
"""

from statistics import median

from fx_contact import sweep
from fx_contact.scenes import hertz
from studies.tables import options, tabulate

REPEATS, APPROACHES, TOLERANCES = 3, (1e-2, 1e-3, 1e-4, 1e-5), (0.05, 0.02)


def pressed(approach):
    """The half-spheres, pressed together by an approach."""
    return hertz(displacement=approach, order=6, coarse=2)


def cost(approaches, tolerance):
    """Solves, unknowns of all of them, and CPU seconds of a load path."""
    runs = [[point.record for point in sweep(pressed, approaches, tolerance)] for _ in range(REPEATS)]
    seconds = median(sum(record.cpu_seconds for record in run) for run in runs)
    return sum(r.solves for r in runs[0]), sum(r.unknowns for r in runs[0]), seconds


def rows():
    """The load path and its last point alone, by tolerance."""
    next(iter(sweep(pressed, APPROACHES[:1], 0.3)))  # compiles
    for tolerance in TOLERANCES:
        path, alone = cost(APPROACHES, tolerance), cost(APPROACHES[-1:], tolerance)
        row = {
            "tolerance": tolerance,
            "points": len(APPROACHES),
            "solves": path[0],
            "dofs": path[1],
            "cpu_s": path[2],
        }
        row |= {"alone_solves": alone[0], "alone_dofs": alone[1], "alone_cpu_s": alone[2]}
        yield row | {"ratio": path[2] / alone[2]}


def main():
    """Run the load paths and their last points, and write the table."""
    tabulate(rows(), options(__doc__, "cost").parse_args().output / "sweeps.csv")


if __name__ == "__main__":
    main()
