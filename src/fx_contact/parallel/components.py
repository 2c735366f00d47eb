"""Connected components of a graph that is spread over the ranks."""

import numpy as np
from mpi4py import MPI


def lowest_labels(comm, part, label, exchange):
    """The lowest label in the connected component of each element.

    Collective on comm.  Each turn carries labels across one border between ranks.

    Args:
        comm: MPI communicator.
        part: (n,) int, the component of each element in this rank's own graph, numbered from 0.
        label: (n,) int64, of each element.
        exchange: function of (n,) int64 labels that gives the lowest of an element's own label and those of the
            elements on other ranks which it is connected to, or the same as; collective.

    Returns:
        (n,) int64.
    """
    while True:
        lowest = np.full(part.max(initial=-1) + 1, np.iinfo(np.int64).max)
        np.minimum.at(lowest, part, label)
        before, label = label, exchange(lowest[part])
        if not comm.allreduce(bool((label != before).any()), op=MPI.LOR):
            return label
