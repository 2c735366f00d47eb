"""Counts on the ranks of a run with how many others each exchanges rows, beside what the study counts.

    mpirun --oversubscribe -n 64 python3 -m studies.partition.on_ranks
    mpirun -n 2 python3 -m studies.partition.on_ranks --few 0      # from point to point on two ranks, too

The last step of Hertz at degree 1. Exchanges by keys are those after the leaves have come to their ranks, as the study
counts them for the partition of the run; the others move leaves and make graphs. It fails where
the study counts something else.
"""

import argparse

import numpy as np
from mpi4py import MPI

from demos.common import RankZeroParser, plain_errors
from fx_contact import adapt
from fx_contact.adaptive import adaptive_loop
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.forest import forest, leaf_graph
from fx_contact.forest.forest import Forest
from fx_contact.parallel import exchange, mpi
from fx_contact.scenes import hertz
from studies.partition.partners import Exchanges

COMM = MPI.COMM_WORLD


class Noted(exchange.Exchange):
    """An exchange by keys that notes its partners."""

    seen = []

    def __init__(self, comm, destination):
        super().__init__(comm, destination)
        if comm.size > 1:
            self.seen.append(len(self.partners))


class NotedOther(Noted):
    """One that is not by keys."""

    seen = []


def run(tolerance):
    """The last step of a run, with the partners of its exchanges noted.  Collective."""
    mpi.Exchange = Noted
    forest.Exchange = leaf_graph.Exchange = NotedOther
    made = adaptive_loop.repartition

    def repartition(*arguments):
        """As the original; what has been by keys before belongs to another partition."""
        NotedOther.seen.clear()
        result = made(*arguments)
        Noted.seen.clear()
        return result

    adaptive_loop.repartition = repartition
    *_, step = adapt(hertz(), tolerance, COMM, degree=1)
    return step


def counted(ours):
    """What the study counts by keys for the ranks as parts: Partners on rank 0, None elsewhere.  Collective."""
    names = "cell", "level", "anchor"
    leaves = COMM.gather([getattr(ours, name) for name in names] + [np.full(len(ours), COMM.rank)])
    if COMM.rank > 0:
        return None
    *columns, part = map(np.concatenate, zip(*leaves))
    serial = Forest(MPI.COMM_SELF, ours.mesh, ours.lattice, ours.pairing, ours.contact_surfaces, *columns)
    cuts = None if exchange.few(COMM) else ours.cuts
    exchanges = Exchanges(serial, Prolongation(Space(serial, 1)), leaf_graph.create_leaf_graph(serial))
    return exchanges.count(COMM.size, part, cuts, {})


def most(seen):
    """Most partners of a rank in any of the exchanges noted, and the mean over the ranks there.  Collective."""
    largest, total = np.array(seen), np.array(seen)
    COMM.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
    COMM.Allreduce(MPI.IN_PLACE, total)
    which = largest.argmax()
    return int(largest[which]), total[which] / COMM.size


def main():
    """Parse, run, compare."""
    options = RankZeroParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--tolerance", type=float, default=0.16, help="of the run (%(default)s)")
    options.add_argument("--few", type=int, default=exchange.FEW_RANKS, help="ranks all to all (%(default)s)")
    arguments = options.parse_args()
    exchange.FEW_RANKS = arguments.few
    with plain_errors(COMM):
        step = run(arguments.tolerance)
    by_keys, others = most(Noted.seen), most(NotedOther.seen)
    expected = counted(step.forest)
    if COMM.rank == 0:
        record = step.record
        print(f"{COMM.size} ranks, {record.cells:,} cells, step {record.step}, {record.seconds['total']:.1f} s")
        print(f"by keys: {len(Noted.seen)} exchanges, most partners {by_keys[0]}, {by_keys[1]:.1f} in the mean")
        print(f"others: {len(NotedOther.seen)} exchanges, most partners {others[0]}, {others[1]:.1f} in the mean")
        print(f"counted by the study: {expected.partners_max} ({expected.exchange}), {expected.partners_mean:.1f}")
    same = COMM.rank or (expected.partners_max, round(expected.partners_mean, 6)) == (
        by_keys[0],
        round(by_keys[1], 6),
    )
    if not COMM.bcast(same):
        raise SystemExit("the study counts other partners than the run has")


if __name__ == "__main__":
    main()
