"""Errors raised on all ranks, and a distributed directory of values by key (rendezvous).

A lattice point is named by an int64 key that every rank computes alike.  Values for a key meet on its *home*, a rank
computed from the key: one exchange there, one back.  Homes are near the leaves that have the keys (`forest.homes`), or
given by a hash.  No rank stores more than its share of the keys.

Collectives of this package use the user's communicator, never one of dolfinx or PETSc.  For collectives of Python
objects mpi4py attaches a lock to the communicator.  Its removal may hang if Python frees a communicator of dolfinx
during an exception.
"""

import pickle
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fx_contact.parallel.arrays import BoolArray, Int32Array, Int64Array, IntArray
from fx_contact.parallel.exchange import Exchange, Scalar

#: 2^64 over the golden ratio, odd: multiples of it lie evenly (D. E. Knuth, The Art of Computer Programming 3, 6.4).
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)


@contextmanager
def together(comm: MPI.Intracomm, timeout: float | None = None) -> Iterator[None]:
    """Run a block of local code; an error on any rank is raised on every rank.

    Collective on comm.  The block must not communicate, unless there is a timeout [s]: if the other ranks do not leave
    it in time, the failed one prints its error and aborts all.

    Raises:
        Exception, SystemExit: that of the block on this rank, else that of the lowest rank with one, as a
            RuntimeError if it cannot be pickled.
    """
    error: BaseException | None = None
    try:
        yield
    except (Exception, SystemExit) as caught:  # the exit of one rank alone would leave the others waiting
        error = caught
    lowest = np.empty(1, dtype=np.int64)
    request = comm.Iallreduce(np.array([comm.size if error is None else comm.rank]), lowest, MPI.MIN)
    end = np.inf if error is None or timeout is None else time.monotonic() + timeout
    while end < np.inf and not request.Test():
        if time.monotonic() > end:
            traceback.print_exception(error)
            comm.Abort(1)
        time.sleep(1e-3)
    request.Wait()
    if lowest[0] < comm.size:
        shared = comm.bcast(_sendable(error), root=int(lowest[0]))
        raise shared if error is None else error


def _sendable(error: BaseException | None) -> BaseException | None:
    """The error, or a RuntimeError with its message if it cannot be pickled."""
    try:
        pickle.loads(pickle.dumps(error))
        return error
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")


def any_true(comm: MPI.Intracomm, values: BoolArray) -> bool:
    """True if a value is true on any rank.  Collective on comm."""
    return bool(comm.allreduce(bool(values.any()), op=MPI.LOR))


def hashed(keys: Int64Array, size: int) -> Int32Array:
    """A rank below `size` for each non-negative key, by Fibonacci hashing: neighbouring keys spread evenly.  Local."""
    bits = keys.astype(np.uint64)
    mixed = (bits ^ bits >> np.uint64(32)) * _GOLDEN
    return ((mixed >> np.uint64(33)) % np.uint64(size)).astype(np.int32)


class Directory:
    """Distributed directory: values registered by several ranks for each of a set of keys.

    Collective on comm, as are all its methods.

    Args:
        keys: (n,) non-negative, without repetition on this rank; several ranks may register the same key.
        home: maps (m,) keys to their home ranks (m,), alike on all ranks; by default a hash.
    """

    def __init__(
        self, comm: MPI.Intracomm, keys: Int64Array, home: Callable[[Int64Array], Int32Array] | None = None
    ) -> None:
        self.comm, self._home = comm, home or partial(hashed, size=comm.size)
        self.keys = np.asarray(keys, dtype=np.int64)
        self._at = self._home(self.keys)
        self._exchange = Exchange(comm, self._at)
        self._distinct, self._slot = np.unique(self._exchange.forward(self.keys), return_inverse=True)

    def asked(self, queries: Int64Array) -> BoolArray:
        """Mask (n,) of this rank's keys that are among the queries (m,) of any rank, repetition allowed."""
        slot, found, _ = self._visit(queries)
        return self._exchange.backward(np.isin(self._slot, slot[found]))

    def lookup(
        self, queries: Int64Array, rows: npt.NDArray[Scalar], given: BoolArray
    ) -> tuple[npt.NDArray[Scalar], BoolArray]:
        """Registered values (m, ...) of queried keys (m,), zero where there is none, and a mask of those that have one.

        Queries may repeat.  Of `rows` (n, ...) those `given` (n,) are registered; values of several ranks are equal.
        """
        queries, back = np.unique(queries, return_inverse=True)
        slot, found, exchange = self._visit(queries)
        wanted = self._exchange.backward(np.isin(self._slot, slot[found]))
        table, known = self._table(rows, given & wanted)
        found[found] = known[slot[found]]
        answer = np.zeros((len(slot), *table.shape[1:]), table.dtype)
        answer[found] = table[slot[found]]
        return exchange.backward(answer)[back], exchange.backward(found)[back]

    def lowest(self, values: Int64Array) -> Int64Array:
        """Minimum (n,) over ranks of the values (n,) for each key."""
        values = self._exchange.forward(values)
        lowest = np.full(len(self._distinct), np.iinfo(np.int64).max)
        np.minimum.at(lowest, self._slot, values)
        return self._exchange.backward(lowest[self._slot])

    def number(
        self, active: BoolArray | None = None, claim: IntArray | None = None, ballot: Int64Array | None = None
    ) -> tuple[Int64Array, Int32Array]:
        """Give each key one owner among the ranks that registered it, and number the keys owner by owner.

        The owner is drawn by `ballot` among the ranks with the highest claim: keys spread evenly, and two with the same
        claimants and ballot have the same owner.

        Args:
            active: (n,), keys to be numbered, alike on all ranks that registered a key; default all.
            claim: (n,); default equal.
            ballot: (n,) non-negative; default the key itself.

        Returns:
            (n,) global numbers, contiguous by owner in the order of its keys, -1 where not active, and (n,) owners.
        """
        n = len(self.keys)
        active = np.ones(n, dtype=bool) if active is None else active
        claims = self._exchange.forward(np.zeros(n, dtype=np.int8) if claim is None else claim.astype(np.int8))
        ballots = self._exchange.forward(self.keys if ballot is None else ballot)
        order = np.lexsort((self._exchange.source, -claims, self._slot))
        slot, claims, ballots = self._slot[order], claims[order], ballots[order]
        first = np.searchsorted(slot, np.arange(len(self._distinct)))
        winners = np.bincount(slot, weights=claims == claims[first][slot], minlength=len(first)).astype(np.int64)
        drawn = first + hashed(ballots[first], 2**31 - 1) % np.maximum(winners, 1)
        owner = self._exchange.backward(self._exchange.source[order[drawn]][self._slot].astype(np.int32))

        own = active & (owner == self.comm.rank)
        offset = self.comm.exscan(int(own.sum())) or 0
        numbers: Int64Array = np.full(n, -1, dtype=np.int64)
        numbers[own] = offset + np.arange(own.sum())
        if self.comm.size > 1:
            table, known = self._table(numbers, own)
            numbers = self._exchange.backward(np.where(known, table, -1)[self._slot])
        return numbers, owner

    def _visit(self, queries: Int64Array) -> tuple[Int64Array, BoolArray, Exchange]:
        """Slots of queried keys at home, a mask of the known ones, and the exchange that brought them."""
        queries = np.asarray(queries, dtype=np.int64)
        exchange = Exchange(self.comm, self._home(queries))
        arrived = exchange.forward(queries)
        slot = np.searchsorted(self._distinct, arrived)
        slot[slot == len(self._distinct)] = 0
        found = self._distinct[slot] == arrived if len(self._distinct) else np.zeros(len(arrived), dtype=bool)
        return slot, found, exchange

    def _table(self, rows: npt.NDArray[Scalar], given: BoolArray) -> tuple[npt.NDArray[Scalar], BoolArray]:
        """Registered values at home, and a mask of the keys that have one; only these are sent."""
        sent = np.flatnonzero(given)
        exchange = Exchange(self.comm, self._at[sent])
        slot = np.searchsorted(self._distinct, exchange.forward(self.keys[sent]))
        rows = exchange.forward(np.asarray(rows)[sent])
        table = np.zeros((len(self._distinct), *rows.shape[1:]), rows.dtype)
        known = np.zeros(len(self._distinct), dtype=bool)
        table[slot], known[slot] = rows, True
        return table, known
