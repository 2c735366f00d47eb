"""Partitions of the leaves, computed anew after each refinement.

    contact-sfc      Hilbert curve; facing leaves form a super-element with the weight of both (section 3 of the paper)
    equidistributed  facing leaves on ranks of their own, the others on the rest, in blocks of equal length (the
                     paper's earlier method)
    sfc              Hilbert curve that ignores contact: pairs may be split
    graph            PT-SCOTCH on the graph of the leaves, facing leaves contracted, after a partition by the curve

A partition is a sequence of stages.  Each redistributes units in the order of the space-filling curve: leaves, or
super-elements of facing leaves with the curve key of one of them.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fx_contact.forest import space_filling_curve
from fx_contact.forest.forest import Forest
from fx_contact.forest.leaf_graph import Graph, create_leaf_graph
from fx_contact.geometry.lattice import anchors_on_faces
from fx_contact.parallel import compat
from fx_contact.parallel.arrays import Int32Array, Int64Array, IntArray
from fx_contact.parallel.errors import PartitionError
from fx_contact.parallel.exchange import few
from fx_contact.parallel.mpi import Directory
from fx_contact.parallel.validation import check_name
from fx_contact.surfaces.facet_pairing import decode_leaf, leaf_code


def curve_keys(forest: Forest, pairs: bool = True) -> Int64Array:
    """Hilbert keys (n,) of the leaves: the same for facing leaves if `pairs`, else distinct.  Local.

    Where meshes do not match, leaves of the second surface have the keys of the places that they face.
    """
    codes = forest.representatives if pairs else leaf_code(forest.cell, forest.anchor)
    names, of_leaf = np.unique(codes, return_inverse=True)
    cell, anchor = decode_leaf(names)
    for facets in forest.contact_surfaces.nonmatching.values() if pairs else ():
        leaf, face = forest.boundary_faces(facets.second.facets)
        found, (place, uv) = facets.faced_by(forest.facets(leaf, face))
        units = of_leaf[leaf[found]]
        cell[units], anchor[units] = place[:, 0], anchors_on_faces(place[:, 1], uv)
    return space_filling_curve.RootCurve(forest.mesh).keys(cell, anchor)[of_leaf]


class Units:
    """This rank's units, in curve order: super-elements of facing leaves if `pairs`, else single leaves.

    Local; the leaves of a super-element must be on one rank.

    Attributes:
        of_leaf: (n,), unit of each leaf.
        keys: (m,), curve key of each unit, ascending.
        weights: (m,), number of leaves of each unit.
        contact: (m,), units with a face on a contact surface.
    """

    def __init__(self, forest: Forest, pairs: bool) -> None:
        self.comm, self._forest = forest.comm, forest
        self.keys, self.of_leaf = np.unique(curve_keys(forest, pairs), return_inverse=True)
        self.weights = np.bincount(self.of_leaf, minlength=len(self.keys))
        self.contact = np.isin(np.arange(len(self.keys)), self.of_leaf[forest.contact_faces()[0]])

    def __len__(self) -> int:
        return len(self.keys)

    @cached_property
    def graph(self) -> Graph:
        """Graph of the units, weighted by the leaf facets between them.  Collective on comm at first use."""
        return create_leaf_graph(self._forest).contracted(self.of_leaf, len(self))


#: (units, number of parts, present parts (m,)) -> (new parts (m,), cuts (parts - 1,) of the curve or None).
Stage: TypeAlias = Callable[[Units, int, Int32Array], tuple[Int32Array, Int64Array | None]]
#: Any values (n, ...) carried by the leaves.
LeafValues: TypeAlias = npt.NDArray[Any]


def along_curve(units: Units, parts: int, _present: Int32Array) -> tuple[Int32Array, Int64Array]:
    """Stage: pieces of equal weight of the Hilbert curve.  Collective on units.comm."""
    cuts = space_filling_curve.cut_curve(units.comm, units.keys, units.weights, parts)
    return np.searchsorted(cuts, units.keys, side="right").astype(np.int32), cuts


def by_graph(units: Units, parts: int, _present: Int32Array) -> tuple[Int32Array, None]:
    """Stage: PT-SCOTCH on the graph of the units.  Collective on units.comm."""
    graph = units.graph
    number = np.concatenate([graph.offset + np.arange(graph.size), graph.ghosts])
    return compat.partition_graph(units.comm, parts, graph.matrix.indptr, number[graph.matrix.indices]), None


def dealt_out(units: Units, parts: int, present: Int32Array) -> tuple[Int32Array, None]:
    """Stage: units with contact on some parts, in proportion to their weight, the other units on the rest.

    Collective on units.comm.  The units of each present part are cut into one block for each new part.  The first
    block goes to the part of the same number, which spreads the remainders.
    """
    mine = np.array([units.weights[units.contact].sum(), units.weights.sum()])
    contact, total = units.comm.allreduce(mine, op=MPI.SUM)
    share = min(max(round(parts * contact / total), int(contact > 0)), parts - int(contact < total))
    result = np.empty(len(units), dtype=np.int32)
    for chosen, first, count in ((units.contact, 0, share), (~units.contact, share, parts - share)):
        rows = np.flatnonzero(chosen)
        order = rows[np.argsort(present[rows], kind="stable")]
        length = np.bincount(present[order], minlength=parts)
        number = np.arange(len(order)) - (np.cumsum(length) - length)[present[order]]
        result[order] = first + (number * count // length[present[order]] + present[order]) % max(count, 1)
    return result, None


@dataclass(frozen=True)
class Kind:
    """A kind of partition by successive stages; `pairs`: facing leaves stay together."""

    pairs: bool
    stages: tuple[Stage, ...]


KINDS = {
    "contact-sfc": Kind(True, (along_curve,)),
    "equidistributed": Kind(True, (dealt_out,)),
    "sfc": Kind(False, (along_curve,)),
    "graph": Kind(True, (along_curve, by_graph)),
}


def repartition(
    forest: Forest, values: LeafValues | None, kind: str = "contact-sfc"
) -> tuple[Forest, LeafValues | None]:
    """Move leaves, and values (n, ...) carried by them, to the ranks that a partition assigns, in curve order.

    Collective on forest.comm; one rank only sorts them.

    Raises:
        SceneError: a kind that is no key of `KINDS`.
        PartitionError: a rank would get no leaf.
    """
    check_name("partition", kind, KINDS)
    comm, pairs = forest.comm, KINDS[kind].pairs
    if comm.size > 1:
        if pairs:
            forest, values = _moved(forest, values, _lowest_ranks(forest))
        for stage in KINDS[kind].stages:
            units = Units(forest, pairs)
            present = np.full(len(units), comm.rank, dtype=np.int32)
            part, cuts = stage(units, comm.size, present)
            forest, values = _moved(forest, values, part[units.of_leaf])
            forest = forest if cuts is None else replace(forest, cuts=cuts)
            if comm.allreduce(len(forest), op=MPI.MIN) == 0:
                raise PartitionError(
                    f"{forest.size_global} leaves cannot be spread over {comm.size} ranks by {kind!r}"
                    f"{', facing leaves together' if pairs else ''}: "
                    "run on fewer ranks, or start from a finer root mesh"
                )
    order = np.argsort(curve_keys(forest, pairs), kind="stable")
    return forest.ordered(order), None if values is None else values[order]


def with_cuts(forest: Forest) -> Forest:
    """Forest with cuts of the curve through its leaves, for homes near them before a repartition.

    Collective on forest.comm; few ranks need no cuts.
    """
    if few(forest.comm):
        return forest
    keys = curve_keys(forest, pairs=False)
    cuts = space_filling_curve.cut_curve(forest.comm, keys, np.ones_like(keys), forest.comm.size)
    return replace(forest, cuts=cuts)


def _moved(forest: Forest, values: LeafValues | None, destination: IntArray) -> tuple[Forest, LeafValues | None]:
    """Forest and values after a migration, unless no leaf moves.  Collective on forest.comm."""
    if not forest.comm.allreduce(bool((destination != forest.comm.rank).any()), op=MPI.LOR):
        return forest, values
    forest, exchange = forest.moved(destination)
    return forest, None if values is None else exchange.forward(values)


def _lowest_ranks(forest: Forest) -> Int32Array:
    """Lowest rank (n,) with a leaf of the same group of facing leaves.  Collective on forest.comm."""
    result = np.full(len(forest), forest.comm.rank, dtype=np.int32)
    paired = np.unique(forest.paired_faces()[0])
    groups, group = np.unique(forest.representatives[paired], return_inverse=True)
    directory = Directory(forest.comm, groups, forest.homes.of_leaves)
    result[paired] = directory.lowest(np.full(len(groups), forest.comm.rank))[group]
    return result
