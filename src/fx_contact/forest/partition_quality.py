"""The measures of a partition that go into the record of every step."""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fx_contact.forest.leaf_graph import create_facing_graph, create_leaf_graph


@dataclass(frozen=True)
class PartitionSummary:
    """Measures of the partition of a run, the parts being the ranks.

    Attributes:
        kind: a key of `partition.KINDS`.
        imbalance: most leaves of a rank over the mean [-].
        cut_facets: leaf facets between two ranks; where one leaf meets four finer ones, those four.
        split_pairs: facing leaf facets whose leaves are on different ranks.
    """

    kind: str
    imbalance: float
    cut_facets: int
    split_pairs: int

    @classmethod
    def of(cls, forest, kind):
        """Measure the partition of a forest.

        Collective on forest.comm.

        Args:
            forest: Forest.
            kind: name of its partition.

        Returns:
            PartitionSummary.
        """
        comm, rank = forest.comm, np.full(len(forest), forest.comm.rank)
        imbalance = comm.allreduce(len(forest), op=MPI.MAX) * comm.size / forest.size_global
        if comm.size == 1:
            return cls(kind, imbalance, 0, 0)
        return cls(kind, imbalance, create_leaf_graph(forest).cut(rank), create_facing_graph(forest).cut(rank))
