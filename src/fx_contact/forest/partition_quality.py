"""How good a partition is: exact measures, distributed.

A part is a number for each leaf.  In a run it is the leaf's rank; a study may score any number of parts on any number
of ranks by the same functions.
"""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from fx_contact.forest.leaf_graph import Graph, create_leaf_graph
from fx_contact.parallel.components import lowest_labels
from fx_contact.parallel.mpi import Directory, Exchange
from fx_contact.problem.facet_pairing import leaf_code

#: A displacement: three float64.
BYTES = 24


@dataclass(frozen=True)
class Quality:
    """Measures of a partition.

    Attributes:
        parts: number of parts.
        imbalance: most leaves of a part over the mean [-].
        weight_imbalance: the same of the weights that were given [-].
        cut_facets: leaf facets between two parts; where one leaf meets four finer ones, those four.
        split_pairs: facing leaf facets whose leaves are in different parts.
        interface_vertices: conforming vertices that several parts need.
        neighbours_max, neighbours_mean: other parts with which a part shares such a vertex.
        halo_bytes: moved by all parts together when each gets the displacements that it needs and does not own.
        halo_bytes_max: received and sent by the part that moves most, each vertex owned by one part that needs it.
        pieces_max, pieces_mean: connected pieces of a part, connected through facets or facing facets.
    """

    parts: int
    imbalance: float
    weight_imbalance: float
    cut_facets: int
    split_pairs: int
    interface_vertices: int
    neighbours_max: int
    neighbours_mean: float
    halo_bytes: int
    halo_bytes_max: int
    pieces_max: int
    pieces_mean: float


@dataclass(frozen=True)
class PartitionSummary:
    """Measures of the partition of a run, as each step's record has them.

    Attributes:
        kind: a key of `partition.KINDS`.
        imbalance, cut_facets, split_pairs: as in `Quality`.
    """

    kind: str
    imbalance: float
    cut_facets: int
    split_pairs: int


def brief(forest, kind):
    """The measures that go into the record of every step, for the parts that the ranks are.

    Collective on forest.comm.

    Args:
        forest: Forest.
        kind: name of the partition, passed on.

    Returns:
        PartitionSummary.
    """
    comm = forest.comm
    part = np.full(len(forest), comm.rank)
    alone = comm.size == 1
    return PartitionSummary(
        kind,
        imbalance=_imbalance(comm, part, np.ones(len(part)), comm.size),
        cut_facets=0 if alone else create_leaf_graph(forest).cut(part),
        split_pairs=0 if alone else _facing(forest).cut(part),
    )


class Judge:
    """Scores partitions of one forest.

    Collective on forest.comm.

    Args:
        forest: Forest.
        prolongation: Prolongation of the forest.
        weights: (n,) of the leaves; default all alike.
    """

    def __init__(self, forest, prolongation, weights=None):
        self.comm = forest.comm
        self._weights = np.ones(len(forest)) if weights is None else weights
        self._graph, self._facing = create_leaf_graph(forest), _facing(forest)
        self._needs = _needs(forest, prolongation)
        imap = prolongation.index_map
        self._number = imap.local_to_global(np.arange(imap.size_local + imap.num_ghosts, dtype=np.int32))

    def score(self, part, parts):
        """Measure a partition.

        Collective on comm.

        Args:
            part: (n,) int, part of each leaf of this rank, in 0..parts - 1.
            parts: number of parts.

        Returns:
            Quality, the same on all ranks.
        """
        pieces = self._pieces(part, parts)
        return Quality(
            parts=parts,
            imbalance=_imbalance(self.comm, part, np.ones(len(part)), parts),
            weight_imbalance=_imbalance(self.comm, part, self._weights, parts),
            cut_facets=self._graph.cut(part),
            split_pairs=self._facing.cut(part),
            **self._interfaces(part, parts),
            pieces_max=int(pieces.max()),
            pieces_mean=float(pieces.mean()),
        )

    def _pieces(self, part, parts):
        """Connected pieces of each part: (parts,) int64."""
        joined = [_inside(graph, part) for graph in (self._graph, self._facing)]
        _, piece = connected_components(sum(inside[:, : len(part)] for inside in joined), directed=False)

        def exchange(label):
            label = label.copy()
            for graph, inside in zip((self._graph, self._facing), joined):
                row, column = inside.nonzero()
                np.minimum.at(label, row, graph.ghosted(label)[column])
            return label

        leaf = self._graph.offset + np.arange(len(part))
        first = lowest_labels(self.comm, piece, leaf, exchange) == leaf
        return _total(self.comm, np.bincount(part[first], minlength=parts))

    def _interfaces(self, part, parts):
        """What `Quality` has of interface vertices, neighbours and halos, by name: dict."""
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
        shared = self.comm.allreduce(len(start))
        return {
            "interface_vertices": shared,
            "neighbours_max": int(neighbours.max()),
            "neighbours_mean": float(neighbours.mean()),
            "halo_bytes": BYTES * int(moved.sum()) // 2,
            "halo_bytes_max": BYTES * int(moved.max()),
        }


def _total(comm, values):
    values = values.astype(np.int64)
    comm.Allreduce(MPI.IN_PLACE, values)
    return values


def _imbalance(comm, part, weights, parts):
    """Largest weight of a part over the mean."""
    loads = np.bincount(part, weights=weights, minlength=parts)
    comm.Allreduce(MPI.IN_PLACE, loads)
    return float(loads.max() * parts / loads.sum())


def _inside(graph, part):
    """The edges of a graph inside parts, as a sparse matrix."""
    same = graph.ghosted(part)[graph.matrix.indices] == part[graph.rows]
    place = graph.rows[same], graph.matrix.indices[same]
    return csr_matrix((np.ones(len(place[0]), dtype=np.int8), place), shape=graph.matrix.shape)


def _facing(forest):
    """The graph whose edges join the leaves of facing leaf facets, wherever they are.  Collective on forest.comm."""
    leaf, face = forest.contact_faces()
    offset = forest.comm.exscan(len(forest)) or 0
    own, index = np.unique(leaf_code(forest.cell[leaf], forest.anchor[leaf]), return_index=True)
    wanted = forest.pairing.partners(forest.cell[leaf], forest.level[leaf], forest.anchor[leaf], face)
    directory = Directory(forest.comm, own)
    other, _ = directory.lookup(leaf_code(*wanted), offset + leaf[index], np.ones(len(own), dtype=bool))
    return Graph(forest.comm, len(forest), leaf, other, np.ones(len(leaf), dtype=np.int64))


def _needs(forest, prolongation):
    """Which conforming nodes each leaf needs: those that its nodes hang on, and those that face it.

    Returns (n, owned + ghosts) scipy CSR, columns as in the prolongation's index map.
    """
    space, count = prolongation.space, len(forest)
    nodes = csr_matrix(
        (np.ones(space.cells.size, dtype=np.int8), space.cells.ravel(), np.arange(count + 1) * space.nodes_per_cell),
        shape=(count, len(space)),
    )
    pattern = prolongation.matrix.astype(bool).astype(np.int8)
    leaf, face = forest.contact_faces()
    first = forest.pairing.first[forest.cell[leaf], face]
    leaf, face = leaf[first], face[first]
    facing = prolongation.find(space.facing(leaf, face).ravel())
    known = facing >= 0
    place = np.repeat(leaf, (space.degree + 1) ** 2)[known], facing[known]
    across = csr_matrix((np.ones(len(place[0]), dtype=np.int8), place), shape=(count, pattern.shape[1]))
    return nodes @ pattern + across
