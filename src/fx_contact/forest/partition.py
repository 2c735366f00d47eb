"""Four kinds of partition of the leaves, made anew after every refinement.

    contact-sfc      the Hilbert curve; facing leaves are one super-element with the weight of both (section 3 of the
                     paper)
    equidistributed  facing leaves on their own share of the ranks, all leaves dealt out by local number (the paper's
                     former way)
    sfc              the Hilbert curve, blind to contact: pairs may be split
    graph            PT-SCOTCH on the graph of the leaves, facing leaves contracted, from where the curve has put them

Each is a sequence of stages.  A stage takes `Units` and their present parts, and returns new ones, and where it has cut
the curve.  A part is a number: of a rank in a run, of any partition in a study.
"""

from dataclasses import dataclass, replace

import numpy as np
from mpi4py import MPI

from fx_contact.forest import space_filling_curve
from fx_contact.forest.super_elements import Units, curve_keys
from fx_contact.parallel import compat
from fx_contact.parallel.errors import PartitionError
from fx_contact.parallel.exchange import few
from fx_contact.parallel.mpi import Directory
from fx_contact.parallel.validation import check_name


def along_curve(units, parts, _home):
    """Pieces of the Hilbert curve of equal weight: (m,) int32 part of each unit, (parts - 1,) int64 the cuts.

    Collective on units.comm.
    """
    cuts = space_filling_curve.cut_curve(units.comm, units.keys, units.weights, parts)
    return np.searchsorted(cuts, units.keys, side="right").astype(np.int32), cuts


def by_graph(units, parts, _home):
    """PT-SCOTCH: (m,) int32 part of each unit, no cuts.  Collective on units.comm."""
    graph = units.graph
    number = np.concatenate([graph.offset + np.arange(graph.size), graph.ghosts])
    return compat.partition_graph(units.comm, parts, graph.matrix.indptr, number[graph.matrix.indices]), None


def dealt_out(units, parts, home):
    """Units with contact on some parts, the others on the rest, block by block of the units' local numbers.

    Collective on units.comm.  Contact gets its share of the parts by weight.  The units of each present part are cut
    into as many blocks as there are new parts, one block for each.  Present parts start dealing at different new parts,
    so that remainders spread.

    Args:
        units: Units.
        parts: number of parts.
        home: (m,) int32, the part on which each unit is now.

    Returns:
        (m,) int32 part of each unit, and None: no cuts.
    """
    mine = np.array([units.weights[units.contact].sum(), units.weights.sum()])
    contact, total = units.comm.allreduce(mine, op=MPI.SUM)
    share = min(max(round(parts * contact / total), int(contact > 0)), parts - int(contact < total))
    result = np.empty(len(units), dtype=np.int32)
    for chosen, first, count in ((units.contact, 0, share), (~units.contact, share, parts - share)):
        rows = np.flatnonzero(chosen)
        order = rows[np.argsort(home[rows], kind="stable")]
        length = np.bincount(home[order], minlength=parts)
        number = np.arange(len(order)) - (np.cumsum(length) - length)[home[order]]
        result[order] = first + (number * count // length[home[order]] + home[order]) % max(count, 1)
    return result, None


@dataclass(frozen=True)
class Kind:
    """A kind of partition.

    Attributes:
        pairs: whether it keeps facing leaves together.
        stages: functions of (units, parts, home) that give the part of each unit, and the cuts of the curve if they
            make them; each starts from where the one before has put the units.
    """

    pairs: bool
    stages: tuple


KINDS = {
    "contact-sfc": Kind(True, (along_curve,)),
    "equidistributed": Kind(True, (dealt_out,)),
    "sfc": Kind(False, (along_curve,)),
    "graph": Kind(True, (along_curve, by_graph)),
}


def repartition(forest, values, kind="contact-sfc"):
    """Move leaves, and data they carry, to the ranks that a partition of the given kind assigns.

    Collective on forest.comm; on one rank nothing is moved.

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
    check_name("partition", kind, KINDS)
    comm, pairs = forest.comm, KINDS[kind].pairs
    if comm.size > 1:
        if pairs:
            forest, values = _moved(forest, values, _meeting_place(forest))
        for stage in KINDS[kind].stages:
            units = Units(forest, pairs)
            here = np.full(len(units), comm.rank, dtype=np.int32)
            part, cuts = stage(units, comm.size, here)
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


def with_cuts(forest):
    """The same forest with the curve cut through its leaves, so that homes are near them before a repartition.

    Collective on forest.comm; on few ranks homes need no cuts.

    Args:
        forest: Forest, its leaves on any ranks.

    Returns:
        Forest.
    """
    if few(forest.comm):
        return forest
    keys = curve_keys(forest, pairs=False)
    return replace(
        forest, cuts=space_filling_curve.cut_curve(forest.comm, keys, np.ones_like(keys), forest.comm.size)
    )


def _moved(forest, values, destination):
    """The forest and the values after a move that concerns any leaf.  Collective on forest.comm."""
    if not forest.comm.allreduce(bool((destination != forest.comm.rank).any()), op=MPI.LOR):
        return forest, values
    forest, exchange = forest.moved(destination)
    return forest, None if values is None else exchange.forward(values)


def _meeting_place(forest):
    """The lowest rank that has a leaf of the same group of facing leaves: (n,) int32.  Collective on forest.comm."""
    result = np.full(len(forest), forest.comm.rank, dtype=np.int32)
    paired = np.unique(forest.paired_faces()[0])
    groups, group = np.unique(forest.representatives[paired], return_inverse=True)
    directory = Directory(forest.comm, groups, forest.homes.of_leaves)
    result[paired] = directory.lowest(np.full(len(groups), forest.comm.rank))[group]
    return result
