"""A manufactured solution on a quarter of a ring: effectivity of the error estimate, and rate of convergence.

The displacement is a smooth bump on the curved inside; the load follows from it. A line for each step has the estimated
and the true error in the energy norm, their ratio (the effectivity), and the error in the L2 norm.

    mpirun -n 2 python3 demos/manufactured.py --tolerance 0.04
    mpirun -n 2 python3 demos/manufactured.py --uniform
"""

from pathlib import Path

from common import COMM, CONTROLS, RankZeroParser, plain_errors
from manufactured_solution import adapt_manufactured

from fx_contact import ErrorControl
from fx_contact.adaptive.settings import DEGREE
from fx_contact.results import RecordWriter

if __name__ == "__main__":
    options = RankZeroParser(description=__doc__.split("\n\n")[0])
    options.add_argument("--tolerance", type=float, default=0.08, help="relative error (%(default)s)")
    options.add_argument("--degree", type=int, metavar="{1,2}", default=DEGREE, help="of displacements (%(default)s)")
    options.add_argument("--order", type=int, default=3, help="of the root mesh's geometry, 1 to 6 (%(default)s)")
    options.add_argument("--coarse", type=int, default=4, help="root cells across the ring (%(default)s)")
    options.add_argument("--control", metavar=CONTROLS, default="contact", help="of marking (%(default)s)")
    options.add_argument("--uniform", action="store_true", help="refine all cells in every step")
    options.add_argument("--output", type=Path, default=Path("results/manufactured"), help="folder (%(default)s)")
    options.add_argument("--quiet", action="store_true", help="print errors only")
    given = options.parse_args()
    with plain_errors(COMM):
        known = {name: getattr(given, name) for name in ("degree", "order", "coarse", "uniform")}
        run = adapt_manufactured(given.tolerance, COMM, control=ErrorControl(given.control), **known)
        records = RecordWriter(given.output, COMM)
        show = print if COMM.rank == 0 and not given.quiet else lambda *_, **__: None
        show("     dofs  hanging  estimate    true  effectivity      L2")
        for step in run:
            r = step.record
            records.write(r)
            figures = f"{r.estimate:8.2%}  {r.true_error:6.2%}  {r.effectivity:11.3f}  {r.l2_error:6.3%}"
            show(f"{r.dofs:9,}  {r.hanging_nodes:7,}  {figures}", flush=True)
        show(f"results in {given.output}: steps.jsonl")
