"""Pairs of intersecting boxes of all ranks, by rendezvous in spatial bins.

A box of size s is in the bins of edge 2^-k S >= s that it touches, eight at most, with the largest size S and the
largest k.  It visits the bins of larger edges, which others are in.  Bins have homes by a hash of their place.
"""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fx_contact.parallel.arrays import FloatArray, Int64Array, IntArray
from fx_contact.parallel.exchange import Exchange
from fx_contact.parallel.mpi import hashed

#: Number of sizes of bins; smaller boxes than 2^-40 S are in the smallest.
_SIZES = 41
#: Odd multipliers of 64 bits, by which the place of a bin becomes a key.
_MIX = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0xD6E8FEB86659FD93], dtype=np.uint64)


@dataclass(frozen=True, eq=False)
class Boxes:
    """Axis-parallel boxes of this rank.

    Attributes:
        low, high: (n, 3), corners.
    """

    low: FloatArray
    high: FloatArray

    def __len__(self) -> int:
        return len(self.low)

    @property
    def sizes(self) -> FloatArray:
        """(n,), largest edge of each box."""
        return np.asarray((self.high - self.low).max(axis=1, initial=0.0))


def meeting_boxes(
    comm: MPI.Intracomm, queries: Boxes, boxes: Boxes, names: Int64Array
) -> tuple[Int64Array, Int64Array]:
    """All pairs of a query of this rank and a box of any rank that intersect or touch, each once.

    Collective on comm.

    Args:
        names: (n, k), what a query is told of each of this rank's boxes.

    Returns:
        (m,) queries, ascending, and (m, k) names of the boxes.
    """
    largest = max(boxes.sizes.max(initial=0.0), queries.sizes.max(initial=0.0))
    largest = comm.allreduce(float(largest), op=MPI.MAX) or 1.0
    asking = _Rows(queries, np.column_stack([np.full(len(queries), comm.rank), np.arange(len(queries))]), largest)
    asked = _Rows(boxes, names, largest)
    pairs = [_meetings(comm, asked, asking, same=True)[::-1], _meetings(comm, asking, asked, same=False)]
    query, name = (np.concatenate(column) for column in zip(*pairs))
    back = Exchange(comm, query[:, 0])
    number, name = back.forward(query[:, 1]), back.forward(name)
    order = np.argsort(number, kind="stable")
    return number[order], name[order]


class _Rows:
    """Boxes, their names (n, k), and the exponents k (n,) of the edges 2^-k S of their bins."""

    def __init__(self, boxes: Boxes, names: Int64Array, largest: float) -> None:
        self.boxes, self.names, self.largest = boxes, names, largest
        smallest = largest * 2.0 ** (1 - _SIZES)
        exponent = np.floor(np.log2(largest / np.maximum(boxes.sizes, smallest)))
        self.exponent = np.clip(exponent, 0, _SIZES - 1).astype(np.int64)

    def in_bins(self, comm: MPI.Intracomm, row: IntArray, exponent: IntArray) -> "tuple[Int64Array, _Rows]":
        """The bins (k, 4), exponent and place, that rows (n,) touch, of given edges, and these rows.

        At the homes of the bins.  Collective on comm.
        """
        edge = self.largest * 2.0 ** -exponent[:, None]
        low, high = (np.floor(corner[row] / edge).astype(np.int64) for corner in (self.boxes.low, self.boxes.high))
        count = high - low + 1
        which, number = _ranges(np.zeros(len(row), dtype=np.int64), count.prod(axis=1))
        place = np.empty((len(which), 4), dtype=np.int64)
        place[:, 0] = exponent[which]
        for axis in range(3):
            place[:, axis + 1] = low[which, axis] + number % count[which, axis]
            number //= count[which, axis]
        exchange, sent = Exchange(comm, hashed(_key(place), comm.size)), row[which]
        boxes = Boxes(exchange.forward(self.boxes.low[sent]), exchange.forward(self.boxes.high[sent]))
        return exchange.forward(place), _Rows(boxes, exchange.forward(self.names[sent]), self.largest)


def _meetings(comm: MPI.Intracomm, hosts: _Rows, guests: _Rows, same: bool) -> tuple[Int64Array, Int64Array]:
    """Names of hosts and of guests that intersect, in bins of the edges of the hosts: larger, or the same if `same`."""
    used = np.isin(np.arange(_SIZES), hosts.exponent)
    comm.Allreduce(MPI.IN_PLACE, used, op=MPI.LOR)
    exponents = np.flatnonzero(used)
    row, column = np.nonzero(exponents <= guests.exponent[:, None] - (not same))
    here, host = hosts.in_bins(comm, np.arange(len(hosts.boxes)), hosts.exponent)
    place, guest = guests.in_bins(comm, row, exponents[column])
    key = _key(here)
    order, asked = np.argsort(key, kind="stable"), _key(place)
    key = key[order]
    two, position = _ranges(np.searchsorted(key, asked), np.searchsorted(key, asked, side="right"))
    one = order[position]
    low = np.maximum(host.boxes.low[one], guest.boxes.low[two])
    meet = (low <= host.boxes.high[one]) & (low <= guest.boxes.high[two]) & (here[one, 1:] == place[two, 1:])
    # Of the bins that both touch the lowest one counts.
    edge = hosts.largest * 2.0 ** -place[two, :1]
    meet &= np.floor(low / edge) == place[two, 1:]
    found = meet.all(axis=1) & (here[one, 0] == place[two, 0])
    return host.names[one[found]], guest.names[two[found]]


def _key(place: Int64Array) -> Int64Array:
    """Keys (n,) of bins (n, 4); a few bins may share one."""
    return ((place.astype(np.uint64) * _MIX).sum(axis=1, dtype=np.uint64) >> np.uint64(1)).astype(np.int64)


def _ranges(start: IntArray, end: IntArray) -> tuple[Int64Array, Int64Array]:
    """Positions (k,) of ranges (n,) and the numbers (k,) in them, range by range."""
    count = end - start
    which = np.repeat(np.arange(len(count)), count)
    return which, np.arange(len(which)) - (np.cumsum(count) - count)[which] + start[which]
