"""The partitions of a forest that the study scores, each made as in a run, after those of the forests before."""

import numpy as np
from mpi4py import MPI

from fx_contact import adapt
from fx_contact.forest.partition import KINDS, along_curve, by_graph, curve_keys
from fx_contact.geometry.lattice import MAX_LEVEL
from fx_contact.parallel.errors import PartitionError
from fx_contact.surfaces.facet_pairing import leaf_code
from studies.partition.assignment import assign

#: PT-SCOTCH differs from run to run, most where parts are few: up to so many parts, the median of so many runs.
REPEATED, REPEATS = 64, 5


class Summing(MPI.Intracomm):
    """A communicator that notes of how many numbers the sums over its ranks are."""

    __module__ = MPI.Intracomm.__module__  # others take communicators of mpi4py by the name of their module
    noted = []

    def Allreduce(self, there, here, *how, **named):  # noqa: N802
        """As MPI's, and note."""
        Summing.noted.append(len(here))
        return super().Allreduce(there, here, *how, **named)


def in_curve_order(forest):
    """The forest with its leaves in the order that a repartition gives them."""
    return forest.ordered(np.argsort(curve_keys(forest), kind="stable"))


def history(make, tolerance, degree):
    """Forests of a run on one rank, then the last with every leaf refined as often as the degree, in curve order."""
    forests = [step.forest for step in adapt(make(), tolerance, MPI.COMM_SELF, degree=degree)]
    for _ in range(degree):
        finest, _ = forests[-1].refined(np.ones(len(forests[-1]), dtype=bool))
        forests.append(in_curve_order(finest))
    return forests


def parents(coarse, fine):
    """The leaf of a forest that each leaf of a refined one lies in: (n,) int64."""
    keys = curve_keys(coarse, pairs=False)
    shift = 3 * (MAX_LEVEL - coarse.level.astype(np.int64))
    start = keys >> shift << shift
    order = np.argsort(start)
    return order[np.searchsorted(start[order], curve_keys(fine, pairs=False), side="right") - 1]


def dealt_out_again(forests, lineage, parts):
    """The equidistributed partition of the last forest, after one of each forest before it, as in a run.

    The run starts where there are enough leaves for all parts, from equal blocks in the order of their numbers.
    """
    home = None
    for forest, parent in zip(forests, lineage):
        if home is None:
            number = np.argsort(np.argsort(leaf_code(forest.cell, forest.anchor)))
            home = number * parts // len(forest)
        else:
            home = home[parent]
        try:
            units, part = assign(forest, parts, "equidistributed", home)
        except PartitionError:
            home = None
            continue
        home = part[units.of_leaf]
    return home


def before(forests, lineage, parts, kind):
    """The part on which each leaf is before, by the partition of the forest before; None if it has too few leaves."""
    if len(forests) == 1:
        return None
    if kind == "equidistributed":
        part = dealt_out_again(forests[:-1], lineage, parts)
    else:
        try:
            units, part = assign(forests[-2], parts, kind)
        except PartitionError:
            return None
        part = part[units.of_leaf]
    return None if part is None else part[lineage[len(forests) - 1]]


def partitions(forests, lineage, parts, pieces):
    """All partitions into a number of parts.

    Args:
        forests, lineage: as of `history`, and `parents` of each.
        parts: number of parts.
        pieces: Units with pairs and without: dict bool -> Units.

    Yields:
        kind: a key of `KINDS`.
        part: (n,) int, part of each leaf.
        cuts: (parts - 1,) int64, of the curve; None if it has none.
        rows: list of (k,) and (k,) int, the parts between which rows go meanwhile, other than by keys.
        sums: dict, how often numbers are summed over the ranks meanwhile, and how many these are in all.
    """
    for units in (pieces[True].graph, *pieces.values()):
        units.comm = Summing(units.comm)
    for kind, about in KINDS.items():
        units, cuts, rows = pieces[about.pairs], None, []
        present = before(forests, lineage, parts, kind)
        Summing.noted.clear()
        if kind == "equidistributed":
            part = dealt_out_again(forests, lineage, parts)
        else:
            curve, cuts = along_curve(units, parts, None)
            part = curve[units.of_leaf]
        if present is not None:
            rows.append((present, part))
        if kind == "graph":
            part = by_graph(units, parts, curve)[0][units.of_leaf]
            rows += [(curve[units.graph.rows], curve[units.graph.matrix.indices]), (curve[units.of_leaf], part)]
        yield kind, part, cuts, rows, {"reductions": len(Summing.noted), "summed": sum(Summing.noted)}


def of_middle_cut(units, parts, first):
    """The partition of the median cut among the first, of PT-SCOTCH, and more runs of it: part of each leaf."""
    found = [first, *(by_graph(units, parts, None)[0][units.of_leaf] for _ in range(REPEATS - 1))]
    representative = np.unique(units.of_leaf, return_index=True)[1]
    return found[np.argsort([units.graph.cut(part[representative]) for part in found])[REPEATS // 2]]
