"""The partitions of a forest that the study scores, each made as in a run."""

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


def history(make, tolerance):
    """Forests of a run of degree 1 on one rank, then the last with every leaf refined, in the order of the curve."""
    forests = [step.forest for step in adapt(make(), tolerance, MPI.COMM_SELF, degree=1)]
    finest, _ = forests[-1].refined(np.ones(len(forests[-1]), dtype=bool))
    return [*forests, finest.ordered(np.argsort(curve_keys(finest), kind="stable"))]


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


def partitions(forests, lineage, parts, pieces):
    """All partitions into a number of parts.

    Args:
        forests, lineage: as of `history`, and `parents` of each.
        parts: number of parts.
        pieces: Units with pairs and without: dict bool -> Units.

    Yields:
        kind: a key of `KINDS`.
        part: (n,) int, part of each leaf.
    """
    for kind, about in KINDS.items():
        units = pieces[about.pairs]
        if kind == "equidistributed":
            yield kind, dealt_out_again(forests, lineage, parts)
        elif kind == "graph":
            curve, _ = along_curve(units, parts, None)
            yield kind, _graph(units, parts, curve)
        else:
            yield kind, along_curve(units, parts, None)[0][units.of_leaf]


def _graph(units, parts, curve):
    """A partition by PT-SCOTCH; the one of the median cut where runs differ most."""
    found = [by_graph(units, parts, curve)[0] for _ in range(REPEATS if parts <= REPEATED else 1)]
    return found[np.argsort([units.graph.cut(part) for part in found])[len(found) // 2]][units.of_leaf]
