"""What differs between releases of dolfinx, by features, not by version numbers; run with 0.9 and 0.11.

dolfinx main builds the dual graph before it calls the partitioner given to `create_mesh` (pull request 4403).
"""

import numpy as np
from dolfinx import graph
from dolfinx.common import IndexMap
from dolfinx.cpp.graph import AdjacencyList_int32, AdjacencyList_int64

#: Tag of the messages in which ranks find their neighbours.
_TAG = 1202


def index_map(comm, owned, ghosts, owners):
    """A dolfinx IndexMap; from 0.10 on it wants a tag for its messages.

    Collective on comm.

    Args:
        comm: MPI communicator.
        owned: number of this rank's own indices.
        ghosts: (n,) int64, global numbers of those of other ranks.
        owners: (n,) int32, the ranks that own them.
    """
    given = {"comm": comm, "local_size": owned, "ghosts": ghosts, "ghost_owners": owners}
    try:
        return IndexMap(**given, tag=_TAG)
    except TypeError:
        return IndexMap(**given)


def geometry_nodes(mesh):
    """Geometry nodes of each local cell: (ncells, nodes) int32, local numbers; after 0.10 a list by cell type.

    Local.

    Args:
        mesh: dolfinx Mesh of cells of one type.
    """
    geometry = mesh.geometry
    return geometry.dofmaps[0] if hasattr(geometry, "dofmaps") else geometry.dofmap


def coordinate_element(mesh):
    """The dolfinx CoordinateElement of a mesh; after 0.10 a list by cell type.

    Local.

    Args:
        mesh: dolfinx Mesh of cells of one type.
    """
    geometry = mesh.geometry
    return geometry.cmaps[0] if hasattr(geometry, "cmaps") else geometry.cmap


def partition_graph(comm, parts, offsets, neighbours):
    """Partition a distributed graph by PT-SCOTCH, or by the default of a dolfinx that was built without it.

    Collective on comm.  Vertices and edges count alike: no release so far takes weights here.

    Args:
        comm: MPI communicator.
        parts: number of parts.
        offsets: (n + 1,) int, start of each vertex of this rank in `neighbours`.
        neighbours: (m,) int64, global numbers of the neighbours, each edge from both its ends.

    Returns:
        (n,) int32 part of each vertex.
    """
    partition = getattr(graph, "partitioner_scotch", graph.partitioner)()
    adjacency = AdjacencyList_int64(neighbours.astype(np.int64), offsets.astype(np.int32))
    destination = partition(comm, parts, adjacency, False)
    return destination.array[destination.offsets[:-1]]


def stay(rank, corners=8):
    """The partitioner to give `dolfinx.mesh.create_mesh` that leaves every cell where it is.

    Local.  dolfinx would move all geometry nodes of a leaf, and compute a dual graph first.

    Args:
        rank: of the calling process.
        corners: of a cell.

    Returns:
        A function for `create_mesh`: dolfinx 0.9 to 0.11 call it with the cells, main with their dual graph.
    """

    def destination(_comm, _parts, first, *others):
        """Every cell on the rank that gave it."""
        count = first.num_nodes if hasattr(first, "num_nodes") else sum(map(len, others[0])) // corners
        return AdjacencyList_int32(np.full((count, 1), rank, dtype=np.int32))

    return destination
