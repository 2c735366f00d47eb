"""Where exchanges from point to point become faster than all to all.

    mpirun --oversubscribe -n 32 python3 -m studies.partition.exchanges

Each rank sends rows to so many partners as a part has in the mean, and gets answers; both ways by turns, so that other
programs disturb both alike. More ranks than cores take turns too: the seconds are those of the messages' work.
"""

import argparse
import time

import numpy as np
from mpi4py import MPI

from demos.common import RankZeroParser
from fx_contact.parallel import exchange

COMM = MPI.COMM_WORLD


def seconds(few, destination, rows):
    """Of one exchange, there and back; the slowest rank.  Collective."""
    exchange.FEW_RANKS = few
    COMM.Barrier()
    start = time.perf_counter()
    there = exchange.Exchange(COMM, destination)
    there.backward(there.forward(rows))
    return COMM.allreduce(time.perf_counter() - start, op=MPI.MAX)


def main():
    """Parse and measure."""
    options = RankZeroParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--partners", type=int, default=10, help="of each rank (%(default)s)")
    options.add_argument("--rows", type=int, default=100, help="for each of them (%(default)s)")
    options.add_argument("--repeats", type=int, default=100, help="pairs of exchanges (%(default)s)")
    arguments = options.parse_args()
    near = np.arange(-(arguments.partners // 2), arguments.partners // 2 + 1)
    ranks = np.unique((COMM.rank + near) % COMM.size)
    destination = np.repeat(ranks, arguments.rows)
    rows = np.arange(len(destination))
    found = np.array(
        [[seconds(few, destination, rows) for few in (COMM.size, 0)] for _ in range(arguments.repeats + 1)]
    )
    if COMM.rank == 0:
        every, some = 1e3 * np.median(found[1:], axis=0)
        print(f"{COMM.size} ranks, {len(ranks) - 1} partners: all to all {every:.2f} ms, partners {some:.2f} ms")


if __name__ == "__main__":
    main()
