"""Quality of a partition, for the record of each step."""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fx_contact.forest.forest import Forest
from fx_contact.forest.leaf_graph import create_facing_graph, create_leaf_graph


@dataclass(frozen=True)
class PartitionSummary:
    """Quality measures of the partition of a run; the parts are the ranks.

    Attributes:
        kind: a key of `partition.KINDS`.
        imbalance: maximum over mean number of leaves per rank [-].
        cut_facets: number of leaf facets between two ranks; a hanging interface counts with its four fine facets.
        split_pairs: number of pairs of facing leaf facets on different ranks.
    """

    kind: str
    imbalance: float
    cut_facets: int
    split_pairs: int

    @classmethod
    def of(cls, forest: Forest, kind: str) -> "PartitionSummary":
        """Measures of the partition of a forest.  Collective on forest.comm."""
        comm, rank = forest.comm, np.full(len(forest), forest.comm.rank)
        imbalance = comm.allreduce(len(forest), op=MPI.MAX) * comm.size / forest.size_global
        if comm.size == 1:
            return cls(kind, imbalance, 0, 0)
        nonmatching = comm.allreduce(sum(facing.split for facing in forest.facing.values()))
        split_pairs = create_facing_graph(forest).cut(rank) + nonmatching
        return cls(kind, imbalance, create_leaf_graph(forest).cut(rank), split_pairs)
