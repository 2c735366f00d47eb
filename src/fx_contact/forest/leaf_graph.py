"""Distributed graphs of leaves: of leaves that share a facet, also across hanging interfaces, and of facing leaves."""

from functools import cached_property

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from scipy.sparse import coo_matrix

from fx_contact.forest.forest import Forest
from fx_contact.geometry.lattice import leaf_side
from fx_contact.parallel.arrays import Int64Array, IntArray
from fx_contact.parallel.exchange import Exchange, Scalar
from fx_contact.parallel.mpi import Directory
from fx_contact.surfaces.facet_pairing import leaf_code


class Graph:
    """Undirected graph whose vertices are numbered rank by rank.

    Collective on comm.

    Args:
        size: number of this rank's vertices.
        rows: (k,), local number of this rank's vertex of an edge; each edge is given from both of its ends.
        columns: (k,), global number of the other vertex; loops are dropped.
        weights: (k,); those of repeated edges are added.

    Attributes:
        offset: global number of this rank's first vertex.
        ghosts: (g,), global numbers of neighbours on other ranks, ascending.
        matrix: (size, size + g), SciPy CSR matrix of the weights, this rank's vertices before the ghosts.
    """

    def __init__(
        self, comm: MPI.Intracomm, size: int, rows: IntArray, columns: Int64Array, weights: Int64Array
    ) -> None:
        self.comm, self.size = comm, size
        ends = np.cumsum(comm.allgather(size))
        self.offset = int(ends[comm.rank]) - size
        proper = columns != rows + self.offset
        rows, columns, weights = rows[proper], columns[proper], weights[proper]
        own = (columns >= self.offset) & (columns < self.offset + size)
        self.ghosts = np.unique(columns[~own])
        local = np.where(own, columns - self.offset, size + np.searchsorted(self.ghosts, columns))
        self.matrix = coo_matrix((weights, (rows, local)), shape=(size, size + len(self.ghosts))).tocsr()
        self._exchange = Exchange(comm, np.searchsorted(ends, self.ghosts, side="right"))
        self._asked = self._exchange.forward(self.ghosts) - self.offset

    @cached_property
    def rows(self) -> Int64Array:
        """(k,), this rank's vertex of each entry of `matrix`.  Local."""
        return np.repeat(np.arange(self.size), np.diff(self.matrix.indptr))

    def ghosted(self, values: npt.NDArray[Scalar]) -> npt.NDArray[Scalar]:
        """Values (size + g,) of this rank's vertices and of the ghosts, from those of its vertices.  Collective."""
        return np.concatenate([values, self._exchange.backward(values[self._asked])])

    def cut(self, part: IntArray) -> int:
        """Weight of all edges between different parts, from the part (size,) of each vertex.  Collective."""
        across = self.ghosted(part)[self.matrix.indices] != part[self.rows]
        return self.comm.allreduce(int(self.matrix.data[across].sum())) // 2

    def contracted(self, group: Int64Array, count: int) -> "Graph":
        """Graph of this rank's `count` groups of its vertices, (size,).  Collective on comm."""
        number = self.ghosted((self.comm.exscan(count) or 0) + group)
        return Graph(self.comm, count, group[self.rows], number[self.matrix.indices], self.matrix.data)


def create_leaf_graph(forest: Forest) -> Graph:
    """Graph with an edge for each facet between two leaves; a hanging interface counts with its fine facets.

    Collective on forest.comm.  Two leaves of one level share a facet if their faces have the same centre.  A leaf's
    face lies in that of a coarser leaf if the centre of the latter is the right corner of the finer leaf.
    """
    comm, count = forest.comm, len(forest)
    ends = np.cumsum(comm.allgather(count))
    start = ends[comm.rank] - count
    number = start + np.arange(count)
    faces, each = forest.faces.cells.ravel(), np.repeat(number, 6)
    low, high = np.empty((2, len(forest.faces.directory.keys)), dtype=np.int64)
    high[faces], low[faces[::-1]] = each, each[::-1]  # the last value stays, and numbers ascend
    lowest = forest.faces.directory.lowest(low)
    both = lowest - forest.faces.directory.lowest(-high)
    other = both[faces] - each
    even = np.flatnonzero(other != each)

    # The corner two steps from the corner a leaf shares with its parent is the centre of a face of the parent.
    leaves = np.flatnonzero(forest.level > 0)
    child = (forest.anchor[leaves] // leaf_side(forest.level[leaves])[:, None] & 1) @ [1, 2, 4]
    centres = forest.corners[leaves[:, None], child[:, None] ^ [3, 5, 6]]
    keys = forest.lattice.keys(forest.cell[leaves], centres).ravel()
    coarse, found = forest.faces.directory.lookup(keys, low, np.ones(len(low), dtype=bool))
    fine, coarse = number[np.repeat(leaves, 3)[found]], coarse[found]
    exchange = Exchange(comm, np.searchsorted(ends, coarse, side="right"))
    rows = np.concatenate([even // 6, fine - start, exchange.forward(coarse) - start])
    columns = np.concatenate([other[even], coarse, exchange.forward(fine)])
    return Graph(comm, count, rows, columns, np.ones(len(rows), dtype=np.int64))


def create_facing_graph(forest: Forest) -> Graph:
    """Graph with an edge for each two facing leaf facets, also on different ranks.  Collective on forest.comm."""
    leaf, face = forest.paired_faces()
    offset = forest.comm.exscan(len(forest)) or 0
    own, index = np.unique(leaf_code(forest.cell[leaf], forest.anchor[leaf]), return_index=True)
    wanted = forest.pairing.partners(forest.cell[leaf], forest.level[leaf], forest.anchor[leaf], face)
    directory = Directory(forest.comm, own, forest.homes.of_leaves)
    other, _ = directory.lookup(leaf_code(*wanted), offset + leaf[index], np.ones(len(own), dtype=bool))
    return Graph(forest.comm, len(forest), leaf, other, np.ones(len(leaf), dtype=np.int64))
