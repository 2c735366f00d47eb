"""Where each leaf goes: the contact-aware space-filling curve, its quality, and the door to `create_mesh`.

A paired leaf takes the curve key of the leaf that stands for its group of facing leaves, and equal keys are never cut
apart: facing leaves stay on one rank after every rebalancing, as the paper's super-elements of weight 2 do (section
3), without a merging step.
"""

import numpy as np
from dolfinx.cpp.graph import AdjacencyList_int32
from mpi4py import MPI

from fx_contact import curve, reference
from fx_contact.errors import PartitionError, SceneError
from fx_contact.forest import find_leaves
from fx_contact.lattice import MAX_LEVEL
from fx_contact.pairing import decode_leaf


def curve_keys(forest):
    """Hilbert key of each leaf; facing leaves have equal keys.

    Local.  Root cells follow the Hilbert curve of their centres; inside a root cell the curve runs in axes that are
    turned to the global ones as closely as the cell allows.  Integers only, so all ranks agree to the last bit.

    Args:
        forest: Forest.

    Returns:
        (n,) int64 keys.
    """
    cell, anchor = decode_leaf(forest.representatives)
    position, axis, flip = _root_curve(forest.mesh)
    local = np.take_along_axis(anchor >> 1, axis[cell], axis=1)
    local = np.where(flip[cell], (1 << MAX_LEVEL) - 1 - local, local)
    # Flipping an anchor gives the far corner of the leaf, which lies in the same leaf: the order is that of the leaves.
    return position[cell] << 3 * MAX_LEVEL | curve.hilbert(local, MAX_LEVEL)


def _root_curve(mesh):
    """Position of each root cell on the curve, and its local axes (ncells, 3) and flips along the global ones."""
    corners = mesh.points[mesh.corners]
    centres = corners.mean(axis=1)
    low = centres.min(axis=0)
    extent = max(np.ptp(centres, axis=0).max(), np.finfo(float).tiny)
    scaled = np.minimum((centres - low) / extent * (1 << 20), (1 << 20) - 1).astype(np.int64)
    position = np.empty(len(centres), dtype=np.int64)
    position[np.argsort(curve.hilbert(scaled, 20), kind="stable")] = np.arange(len(centres))

    slope = np.einsum("va,nvg->nga", 2.0 * reference.CORNERS - 1, corners)
    slope /= np.linalg.norm(slope, axis=1)[:, None]
    permutations = np.array([[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]])
    alignment = np.abs(slope[:, np.arange(3), permutations]).sum(axis=2)
    axis = permutations[alignment.argmax(axis=1)]
    flip = np.take_along_axis(slope, axis[:, :, None], axis=2)[:, :, 0] < 0
    return position, axis, flip


def contact_sfc(forest):
    """Destination of each leaf on the contact-aware Hilbert curve.

    Collective on forest.comm.

    Args:
        forest: Forest.

    Returns:
        (n,) int32 ranks and (n,) int64 curve keys.
    """
    keys = curve_keys(forest)
    cuts = curve.cut(forest.comm, keys, np.ones(len(keys), dtype=np.int64), forest.comm.size)
    return np.searchsorted(cuts, keys, side="right").astype(np.int32), keys


KINDS = {"contact-sfc": contact_sfc}


def repartition(forest, values, kind="contact-sfc"):
    """Move leaves, and data they carry, to the ranks that a partition of the given kind assigns.

    Collective on forest.comm; on one rank nothing is moved or sorted.

    Args:
        forest: Forest.
        values: (n, ...) array carried by the leaves, or None.
        kind: a key of `KINDS`.

    Returns:
        The new Forest, each rank's leaves in curve order, and the (m, ...) values or None.

    Raises:
        SceneError: unknown kind.
        PartitionError: a rank would get no leaf.
    """
    if kind not in KINDS:
        raise SceneError(f"unknown partition {kind!r}; there are {', '.join(map(repr, KINDS))}")
    destination, keys = KINDS[kind](forest)
    if forest.comm.size > 1:
        forest, exchange = forest.moved(destination)
        keys = exchange.forward(keys)
        values = None if values is None else exchange.forward(values)
        fewest = forest.comm.allreduce(len(forest), op=MPI.MIN)
        if fewest == 0:
            raise PartitionError(
                f"{forest.size_global} leaves cannot be spread over {forest.comm.size} ranks, facing leaves together: "
                "run on fewer ranks, or start from a finer root mesh"
            )
    order = np.argsort(keys, kind="stable")
    return forest.ordered(order), None if values is None else values[order]


def partitioner(comm):
    """The partitioner to give `dolfinx.mesh.create_mesh` for leaves that are already where they belong.

    Local.  The leaves were moved along the curve with sixteen bytes each; had dolfinx to move them, it would move all
    geometry nodes, and would compute a dual graph first.

    Args:
        comm: MPI communicator.
    """

    def stay(_comm, _parts, _cell_types, cells):
        count = sum(len(c) for c in cells) // 8
        return AdjacencyList_int32(np.full((count, 1), comm.rank, dtype=np.int32))

    return stay


def quality(forest, kind):
    """How good the present distribution of the leaves is.

    Collective on forest.comm.

    Args:
        forest: Forest.
        kind: name of the partition, passed on.

    Returns:
        dict with kind, imbalance (largest number of leaves over the mean), cut_facets (leaf facets between two
        ranks, across hanging interfaces too) and split_pairs (facing leaves on different ranks).
    """
    comm = forest.comm
    if comm.size == 1:
        return {"kind": kind, "imbalance": 1.0, "cut_facets": 0, "split_pairs": 0}
    largest = comm.allreduce(len(forest), op=MPI.MAX)
    leaf, face = forest.contact_faces()
    own = forest.pairing.first[forest.cell[leaf], face]
    leaf, face = leaf[own], face[own]
    partners = forest.pairing.partners(forest.cell[leaf], forest.level[leaf], forest.anchor[leaf], face)
    split = int((find_leaves(forest, *partners) < 0).sum())
    return {
        "kind": kind,
        "imbalance": largest * comm.size / forest.size_global,
        "cut_facets": comm.allreduce(_cut_facets(forest)),
        "split_pairs": comm.allreduce(split),
    }


def _cut_facets(forest):
    """This rank's share of the leaf facets between ranks: even faces by the lower rank, hanging ones by the finer."""
    faces, vertices = forest.faces, forest.vertices
    rank = np.full(len(faces.directory.keys), forest.comm.rank, dtype=np.int64)
    lowest = faces.directory.lowest(rank)
    even = int((lowest < forest.comm.rank).sum())
    # The corner two steps from the corner a leaf shares with its parent is the centre of a face of the parent.
    child = (forest.anchor // (1 << (MAX_LEVEL + 1 - forest.level.astype(np.int32)))[:, None] & 1) @ [1, 2, 4]
    centres = vertices.keys[vertices.cells[np.arange(len(forest))[:, None], child[:, None] ^ [3, 5, 6]]]
    centres = centres[forest.level > 0].ravel()
    coarse, found = faces.directory.lookup(centres, rank, np.ones(len(rank), dtype=bool))
    return even + int((found & (coarse != forest.comm.rank)).sum())
