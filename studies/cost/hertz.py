"""The README's table: force, largest pressure and contact radius against an independent reference, in Markdown.

The reference is an axisymmetric P2 computation of the same half-spheres (R = 1, E = 1, nu = 0.3, approach 0.01) with
exact non-penetration, converged to the digits given. Seconds are without compilation.

    mpirun -n 2 python3 -m studies.cost.hertz
"""

import argparse

from mpi4py import MPI

from demos.common import RankZeroParser, plain_errors
from fx_contact import adapt
from fx_contact.results.reference_values import hertz_a
from fx_contact.scenes import hertz

FIGURES = ("force", "max_pressure", "contact_radius")
CASES = {
    "--tolerance 0.16": dict(tolerance=0.16),
    "--tolerance 0.08": dict(tolerance=0.08),
    "--tolerance 0.04": dict(tolerance=0.04),
    "--order 6": dict(tolerance=0.08, order=6),
    "--symmetry full": dict(tolerance=0.08, symmetry="full"),
}


def row(options, tolerance, **scene):
    """One row: the last step of a run, and the seconds of all its steps."""
    records = [step.record for step in adapt(hertz(**scene), tolerance)]
    last = records[-1]
    seconds = sum(r.seconds["total"] - r.seconds["compile"] for r in records)
    reference = hertz_a()
    errors = (f"{100 * (getattr(last, name) / getattr(reference, name) - 1):+.3f} %" for name in FIGURES)
    size = f"{last.cells:,} | {last.dofs:,}"
    return f"| `demos/hertz.py {options}` | {size} | {' | '.join(errors)} | {seconds:.1f} |"


def main():
    """Print the table."""
    RankZeroParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    show = print if MPI.COMM_WORLD.rank == 0 else lambda *_, **__: None
    show("| command | cells | dofs | force | largest pressure | contact radius | seconds |")
    show("|---|---|---|---|---|---|---|")
    with plain_errors(MPI.COMM_WORLD):
        for name, case in CASES.items():
            show(row(name, **case), flush=True)


if __name__ == "__main__":
    main()
