"""Differences between releases of dolfinx, detected by features, not by version numbers; run with 0.9 and 0.11.

dolfinx main builds the dual graph before it calls the partitioner given to `create_mesh` (pull request 4403).
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from dolfinx import graph
from dolfinx.common import IndexMap
from dolfinx.cpp.graph import AdjacencyList_int32, AdjacencyList_int64
from dolfinx.mesh import Mesh
from mpi4py import MPI

from fx_contact.parallel.arrays import Int32Array, Int64Array, IntArray

#: Tag of the messages by which IndexMap finds the neighbours of a rank.
_TAG = 1202


def index_map(comm: MPI.Intracomm, owned: int, ghosts: Int64Array, owners: Int32Array) -> IndexMap:
    """IndexMap with ghosts (n,), global numbers, and their owner ranks (n,); since 0.10 it takes a message tag.

    Collective on comm.
    """
    given: dict[str, Any] = {"comm": comm, "local_size": owned, "ghosts": ghosts, "ghost_owners": owners}
    try:
        return IndexMap(**given, tag=_TAG)
    except TypeError:
        return IndexMap(**given)


def geometry_nodes(mesh: Mesh) -> Int32Array:
    """Geometry nodes (ncells, nodes) of each local cell; after dolfinx 0.10 a list by cell type.  Local."""
    return mesh.geometry.dofmaps[0] if hasattr(mesh.geometry, "dofmaps") else mesh.geometry.dofmap


def coordinate_element(mesh: Mesh) -> Any:
    """CoordinateElement of a mesh of one cell type; after dolfinx 0.10 a list by cell type.  Local."""
    return mesh.geometry.cmaps[0] if hasattr(mesh.geometry, "cmaps") else mesh.geometry.cmap


def partition_graph(comm: MPI.Intracomm, parts: int, offsets: IntArray, neighbours: IntArray) -> Int32Array:
    """Part (n,) of each vertex of a distributed graph, by PT-SCOTCH or else by dolfinx's default partitioner.

    Collective on comm.  Vertices and edges have no weights: no release takes them here so far.

    Args:
        offsets: (n + 1,), start of each vertex of this rank in `neighbours`.
        neighbours: (m,), global numbers; each edge is given from both of its ends.
    """
    partition = getattr(graph, "partitioner_scotch", graph.partitioner)()
    adjacency = AdjacencyList_int64(neighbours.astype(np.int64), offsets.astype(np.int32))
    destination = partition(comm, parts, adjacency, False)
    return destination.array[destination.offsets[:-1]]


def stay(rank: int, corners: int = 8) -> Callable[..., Any]:
    """Partitioner for `dolfinx.mesh.create_mesh` that leaves every cell, of so many corners, on its rank.

    Local.  Otherwise dolfinx would compute a dual graph and move all geometry nodes.  dolfinx 0.9 to 0.11 call the
    partitioner with the cells, the main branch of dolfinx with their dual graph.
    """

    def destination(_comm: MPI.Intracomm, _parts: int, first: Any, *others: Any) -> Any:
        """Destination ranks of the cells."""
        count = first.num_nodes if hasattr(first, "num_nodes") else sum(map(len, others[0])) // corners
        return AdjacencyList_int32(np.full((count, 1), rank, dtype=np.int32))

    return destination
