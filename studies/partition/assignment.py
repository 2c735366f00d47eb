"""Partitions into any number of parts, on any number of ranks."""

import numpy as np

from fx_contact.forest.partition import KINDS, Units
from fx_contact.parallel.errors import PartitionError


def assign(forest, parts, kind, home=None):
    """A partition into any number of parts, without moving a leaf.

    Collective on forest.comm; facing leaves are on one rank, and for "contact-sfc" what is on one part too.

    Args:
        forest: Forest.
        parts: number of parts.
        kind: a key of `KINDS`.
        home: (n,) int, the part on which each leaf is before; default the first.

    Returns:
        Units of the kind, and the (m,) int32 part of each.

    Raises:
        PartitionError: more parts than units.
    """
    units = Units(forest, KINDS[kind].pairs)
    if parts > units.comm.allreduce(len(units)):
        raise PartitionError(f"{forest.size_global} leaves cannot be spread over {parts} parts by {kind!r}")
    part = np.zeros(len(units), dtype=np.int32)
    if home is not None:
        part[units.of_leaf] = home
    for stage in KINDS[kind].stages:
        part, _ = stage(units, parts, part)
    return units, part
