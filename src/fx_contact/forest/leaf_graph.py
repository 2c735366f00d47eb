"""The graph of the leaves, distributed like them: leaves that share a facet, across hanging interfaces too.

Contracting it gives the graph of any groups of leaves, such as facing ones.
"""

from functools import cached_property

import numpy as np
from scipy.sparse import coo_matrix

from fx_contact.parallel.exchange import Exchange
from fx_contact.parallel.mpi import Directory
from fx_contact.problem.facet_pairing import leaf_code
from fx_contact.problem.lattice import MAX_LEVEL


class Graph:
    """An undirected graph whose vertices are numbered rank by rank.

    Collective on comm.

    Args:
        comm: MPI communicator.
        size: number of this rank's vertices.
        rows: (k,) int64, a vertex of this rank by its local number; each edge is given from both its ends.
        columns: (k,) int64, its neighbour by its global number; loops are dropped.
        weights: (k,) int64; those of repeated edges are added.

    Attributes:
        comm, size: as given.
        ends: (ranks,) int64, global number behind the last vertex of each rank.
        offset: global number of this rank's first vertex.
        ghosts: (g,) int64, global numbers of other ranks' vertices that are neighbours of this rank's, ascending.
        matrix: (size, size + g) scipy CSR int64 of the weights, this rank's vertices first, then the ghosts.
    """

    def __init__(self, comm, size, rows, columns, weights):
        self.comm, self.size = comm, size
        self.ends = _ends(comm, size)
        self.offset = int(self.ends[comm.rank]) - size
        proper = columns != rows + self.offset
        rows, columns, weights = rows[proper], columns[proper], weights[proper]
        own = (columns >= self.offset) & (columns < self.offset + size)
        self.ghosts = np.unique(columns[~own])
        local = np.where(own, columns - self.offset, size + np.searchsorted(self.ghosts, columns))
        self.matrix = coo_matrix((weights, (rows, local)), shape=(size, size + len(self.ghosts))).tocsr()
        self._exchange = Exchange(comm, np.searchsorted(self.ends, self.ghosts, side="right"))
        self._asked = self._exchange.forward(self.ghosts) - self.offset

    @cached_property
    def rows(self):
        """(k,) int64, this rank's vertex of each entry of `matrix`.  Local."""
        return np.repeat(np.arange(self.size), np.diff(self.matrix.indptr))

    def ghosted(self, values):
        """Values of this rank's vertices and of the ghosts.

        Collective on comm.

        Args:
            values: (size,) array.

        Returns:
            (size + ghosts,) array.
        """
        return np.concatenate([values, self._exchange.backward(values[self._asked])])

    def cut(self, part):
        """Weight of all edges between different parts.

        Collective on comm.

        Args:
            part: (size,) int, part of each vertex.

        Returns:
            int, the same on all ranks.
        """
        across = self.ghosted(part)[self.matrix.indices] != part[self.rows]
        return self.comm.allreduce(int(self.matrix.data[across].sum())) // 2

    def contracted(self, group, count):
        """The graph of groups of vertices, each group on one rank.

        Collective on comm.

        Args:
            group: (size,) int64, group of each vertex in 0..count - 1 of this rank.
            count: number of this rank's groups.

        Returns:
            Graph.
        """
        number = self.ghosted((self.comm.exscan(count) or 0) + group)
        return Graph(self.comm, count, group[self.rows], number[self.matrix.indices], self.matrix.data)


def create_leaf_graph(forest):
    """The graph of the leaves, an edge for every facet between two of them; hanging facets count one by one.

    Collective on forest.comm.  Two leaves of one level share a facet if their faces have the same centre; a leaf's face
    lies in a coarser leaf's if that leaf has a face whose centre is the right corner of the finer leaf.

    Args:
        forest: Forest.

    Returns:
        Graph.
    """
    comm, count = forest.comm, len(forest)
    ends = _ends(comm, count)
    number = ends[comm.rank] - count + np.arange(count)
    faces, each = forest.faces.cells.ravel(), np.repeat(number, 6)
    low, high = np.empty((2, len(forest.faces.directory.keys)), dtype=np.int64)
    high[faces], low[faces[::-1]] = each, each[::-1]  # the last value stays, and numbers ascend
    lowest = forest.faces.directory.lowest(low)
    both = lowest - forest.faces.directory.lowest(-high)
    other = both[faces] - each
    even = np.flatnonzero(other != each)

    # The corner two steps from the corner a leaf shares with its parent is the centre of a face of the parent.
    fine = np.flatnonzero(forest.level > 0)
    child = (forest.anchor[fine] >> (MAX_LEVEL + 1 - forest.level[fine].astype(np.int32))[:, None] & 1) @ [1, 2, 4]
    centres = forest.corners[fine[:, None], child[:, None] ^ [3, 5, 6]]
    keys = forest.lattice.keys(forest.cell[fine], centres).ravel()
    coarse, found = forest.faces.directory.lookup(keys, low, np.ones(len(low), dtype=bool))
    fine, coarse = number[np.repeat(fine, 3)[found]], coarse[found]
    exchange = Exchange(comm, np.searchsorted(ends, coarse, side="right"))
    start = ends[comm.rank] - count
    rows = np.concatenate([even // 6, fine - start, exchange.forward(coarse) - start])
    columns = np.concatenate([other[even], coarse, exchange.forward(fine)])
    return Graph(comm, count, rows, columns, np.ones(len(rows), dtype=np.int64))


def _ends(comm, count):
    """Number behind the last of this and of each other rank's things: (ranks,) int64.  Collective on comm."""
    counts = np.empty(comm.size, dtype=np.int64)
    comm.Allgather(np.array([count]), counts)
    return np.cumsum(counts)


def create_facing_graph(forest):
    """The graph of facing leaves, an edge for every two facing leaf facets, on whatever ranks they are.

    Collective on forest.comm.

    Args:
        forest: Forest.

    Returns:
        Graph.
    """
    leaf, face = forest.paired_faces()
    offset = forest.comm.exscan(len(forest)) or 0
    own, index = np.unique(leaf_code(forest.cell[leaf], forest.anchor[leaf]), return_index=True)
    wanted = forest.pairing.partners(forest.cell[leaf], forest.level[leaf], forest.anchor[leaf], face)
    directory = Directory(forest.comm, own, forest.homes.of_leaves)
    other, _ = directory.lookup(leaf_code(*wanted), offset + leaf[index], np.ones(len(own), dtype=bool))
    return Graph(forest.comm, len(forest), leaf, other, np.ones(len(leaf), dtype=np.int64))
