"""How good a partition is into any number of parts, on any number of ranks: exact measures, distributed."""

import numpy as np
from mpi4py import MPI
from scipy.sparse import csr_matrix

from fx_contact.forest.leaf_graph import create_facing_graph, create_leaf_graph
from fx_contact.parallel.exchange import Exchange

#: A displacement: three float64.
BYTES = 24


class Judge:
    """Scores partitions of one forest.

    Collective on forest.comm.

    Args:
        forest: Forest.
        prolongation: Prolongation of the forest.
    """

    def __init__(self, forest, prolongation):
        self.comm = forest.comm
        self._graph, self._facing = create_leaf_graph(forest), create_facing_graph(forest)
        self._needs = _needs(forest, prolongation)
        imap = prolongation.index_map
        self._number = imap.local_to_global(np.arange(imap.size_local + imap.num_ghosts, dtype=np.int32))

    def score(self, part, parts):
        """Measures of a partition: (n,) int, the part of each leaf of this rank.  Collective on comm.

        Returns:
            dict, the same on all ranks:
            imbalance: most leaves of a part over the mean [-].
            cut_facets: leaf facets between two parts; where one leaf meets four finer ones, those four.
            split_pairs: facing leaf facets whose leaves are in different parts.
            neighbours_max: most other parts with which a part shares a conforming node that both need.
            halo_bytes: moved by all parts together when each gets the displacements that it needs and does not own.
            halo_bytes_max: received and sent by the part that moves most, each node owned by one part that needs it.
        """
        loads = _total(self.comm, np.bincount(part, minlength=parts))
        return {
            "imbalance": float(loads.max() * parts / loads.sum()),
            "cut_facets": self._graph.cut(part),
            "split_pairs": self._facing.cut(part),
            **self._interfaces(part, parts),
        }

    def _interfaces(self, part, parts):
        count = len(part)
        chosen = csr_matrix((np.ones(count, dtype=np.int32), (part, np.arange(count))), shape=(parts, count))
        who, where = (chosen @ self._needs).nonzero()
        # Who needs a vertex is brought together on one rank, which then knows all parts that meet there.
        vertex = self._number[where]
        exchange = Exchange(self.comm, vertex % self.comm.size)
        rows = np.unique(exchange.forward(np.stack([vertex, who], axis=1)), axis=0)
        vertex, who = rows.T
        start = np.flatnonzero(np.diff(vertex, prepend=-1))
        several = np.diff(np.append(start, len(vertex)))
        meeting = np.repeat(several > 1, several)
        place, who = np.repeat(np.arange(len(start)), several)[meeting], who[meeting]
        touches = csr_matrix((np.ones(len(who), dtype=np.int32), (who, place)), shape=(parts, len(start)))
        one, other = (touches @ touches.T).nonzero()
        pairs = np.stack([one, other], axis=1)[one != other]
        exchange = Exchange(self.comm, pairs[:, 0] % self.comm.size)
        pairs = np.unique(exchange.forward(pairs), axis=0)
        neighbours = _total(self.comm, np.bincount(pairs[:, 0], minlength=parts))

        start, several = start[several > 1], several[several > 1]
        owner = rows[start + vertex[start] % several, 1] if len(start) else start
        received = np.bincount(who, minlength=parts) - np.bincount(owner, minlength=parts)
        sent = np.bincount(owner, weights=several - 1, minlength=parts).astype(np.int64)
        moved = _total(self.comm, received + sent)
        return {
            "neighbours_max": int(neighbours.max()),
            "halo_bytes": BYTES * int(moved.sum()) // 2,
            "halo_bytes_max": BYTES * int(moved.max()),
        }


def _total(comm, values):
    values = values.astype(np.int64)
    comm.Allreduce(MPI.IN_PLACE, values)
    return values


def _needs(forest, prolongation):
    """Which conforming nodes each leaf needs: those that its nodes hang on, and those that face it.

    Returns (n, owned + ghosts) scipy CSR, columns as in the prolongation's index map.
    """
    space, count = prolongation.space, len(forest)
    nodes = csr_matrix(
        (np.ones(space.cells.size, dtype=np.int8), space.cells.ravel(), np.arange(count + 1) * space.cells.shape[1]),
        shape=(count, len(space)),
    )
    pattern = prolongation.matrix.astype(bool).astype(np.int8)
    leaf, face = forest.contact_faces()
    first = ~forest.pairing.second[forest.cell[leaf], face]
    leaf, face = leaf[first], face[first]
    facing = prolongation.find(space.facing(leaf, face).ravel())
    known = facing >= 0
    place = np.repeat(leaf, (space.degree + 1) ** 2)[known], facing[known]
    across = csr_matrix((np.ones(len(place[0]), dtype=np.int8), place), shape=(count, pattern.shape[1]))
    return nodes @ pattern + across
