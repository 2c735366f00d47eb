"""How good a partition is into any number of parts, on any number of ranks: exact measures, distributed."""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from fx_contact.forest.leaf_graph import create_facing_graph, create_leaf_graph
from fx_contact.parallel.exchange import Exchange

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
        unknowns_imbalance: most conforming nodes that a part needs over the mean [-].
        interface_nodes: conforming nodes that several parts need.
        neighbours_max, neighbours_mean: other parts with which a part shares such a node.
        halo_bytes: moved by all parts together when each gets the displacements that it needs and does not own.
        halo_bytes_max: received and sent by the part that moves most, each node owned by one part that needs it.
        pieces_max, pieces_mean: connected pieces of a part, connected through facets or facing facets.
    """

    parts: int
    imbalance: float
    weight_imbalance: float
    cut_facets: int
    split_pairs: int
    unknowns_imbalance: float
    interface_nodes: int
    neighbours_max: int
    neighbours_mean: float
    halo_bytes: int
    halo_bytes_max: int
    pieces_max: int
    pieces_mean: float


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
        self._graph, self._facing = create_leaf_graph(forest), create_facing_graph(forest)
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
            """The lowest of each leaf's label and those of its neighbours in the same part."""
            label = label.copy()
            for graph, inside in zip((self._graph, self._facing), joined):
                row, column = inside.nonzero()
                np.minimum.at(label, row, graph.ghosted(label)[column])
            return label

        leaf = self._graph.offset + np.arange(len(part))
        first = _lowest_labels(self.comm, piece, leaf, exchange) == leaf
        return _total(self.comm, np.bincount(part[first], minlength=parts))

    def _interfaces(self, part, parts):
        """What `Quality` has of unknowns, interface nodes, neighbours and halos, by name: dict."""
        count = len(part)
        chosen = csr_matrix((np.ones(count, dtype=np.int32), (part, np.arange(count))), shape=(parts, count))
        who, where = (chosen @ self._needs).nonzero()
        # Who needs a vertex is brought together on one rank, which then knows all parts that meet there.
        vertex = self._number[where]
        exchange = Exchange(self.comm, vertex % self.comm.size)
        rows = np.unique(exchange.forward(np.stack([vertex, who], axis=1)), axis=0)
        vertex, who = rows.T
        needed = _total(self.comm, np.bincount(who, minlength=parts))
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
            "unknowns_imbalance": float(needed.max() / needed.mean()),
            "interface_nodes": shared,
            "neighbours_max": int(neighbours.max()),
            "neighbours_mean": float(neighbours.mean()),
            "halo_bytes": BYTES * int(moved.sum()) // 2,
            "halo_bytes_max": BYTES * int(moved.max()),
        }


def _lowest_labels(comm, part, label, exchange):
    """The lowest label in the connected component of each element: (n,) int64.

    Collective on comm.  Each turn carries labels across one border between ranks.

    Args:
        comm: MPI communicator.
        part: (n,) int, the component of each element in this rank's own graph, numbered from 0.
        label: (n,) int64, of each element.
        exchange: function of (n,) int64 labels that gives the lowest of an element's own label and those of the
            elements that it is connected to; collective.
    """
    while True:
        lowest = np.full(part.max(initial=-1) + 1, np.iinfo(np.int64).max)
        np.minimum.at(lowest, part, label)
        before, label = label, exchange(lowest[part])
        if not comm.allreduce(bool((label != before).any()), op=MPI.LOR):
            return label


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
    first = forest.contact_surfaces.side[forest.cell[leaf], face] == 0
    leaf, face = leaf[first], face[first]
    facing = prolongation.find(space.facing(leaf, face).ravel())
    known = facing >= 0
    place = np.repeat(leaf, (space.degree + 1) ** 2)[known], facing[known]
    across = csr_matrix((np.ones(len(place[0]), dtype=np.int8), place), shape=(count, pattern.shape[1]))
    return nodes @ pattern + across
