"""Errors raised on all ranks together, and what all ranks know of a key (rendezvous).

A lattice point is named by an int64 key that every rank computes alike.  What ranks know of a key is brought together
on its *home*, a rank that follows from the key: one exchange there, one back.  Homes are near the leaves that have the
keys (`forest.homes`), or given by a hash.  No rank holds more than its share of the keys.

Collectives of this package use the user's communicator, never one of dolfinx or PETSc.  A collective of Python objects
makes mpi4py attach a lock to the communicator, which is removed when the communicator is freed; Python frees those of
dolfinx at any time, also while it handles an exception, and the removal may then hang.
"""

import pickle
import time
import traceback
from contextlib import contextmanager
from functools import partial

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fx_contact.parallel.exchange import Exchange

#: 2^64 over the golden ratio, odd: multiples of it lie evenly (D. E. Knuth, The Art of Computer Programming 3, 6.4).
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)


@contextmanager
def together(comm, timeout=None):
    """Run a block of local code; if it raises on any rank, raise that error on every rank.

    Collective on comm.  The block must not communicate, unless there is a timeout.

    Args:
        comm: MPI communicator.
        timeout: of a block that communicates [s].  The other ranks may wait for the failed one inside the block, where
            nothing reaches them: if they do not come out in time, it prints its error and aborts them all.

    Raises:
        Exception: the error of the lowest rank on which the block failed.
    """
    error = None
    try:
        yield
    except (Exception, SystemExit) as caught:  # an exit of one rank alone would leave the others waiting
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


def _sendable(error):
    """The error, or one that says the same if it cannot be pickled.  Local."""
    try:
        pickle.loads(pickle.dumps(error))
        return error
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")


def hashed(keys: npt.NDArray[np.int64], size: int) -> npt.NDArray[np.int32]:
    """A rank below `size` for each non-negative key, by Fibonacci hashing: neighbouring keys spread evenly.  Local."""
    bits = keys.astype(np.uint64)
    mixed = (bits ^ bits >> np.uint64(32)) * _GOLDEN
    return ((mixed >> np.uint64(33)) % np.uint64(size)).astype(np.int32)


class Directory:
    """What all ranks together know of a set of keys.

    Collective on comm, as are all its methods.

    Args:
        comm: MPI communicator.
        keys: (n,) int64 non-negative, without repetition on this rank; several ranks may register the same key.
        home: function of (m,) int64 keys that gives their home ranks, (m,) int32, the same on all ranks; default by a
            hash.
    """

    def __init__(self, comm, keys, home=None):
        self.comm, self._home = comm, home or partial(hashed, size=comm.size)
        self.keys = np.asarray(keys, dtype=np.int64)
        self._at = self._home(self.keys)
        self._exchange = Exchange(comm, self._at)
        self._distinct, self._slot = np.unique(self._exchange.forward(self.keys), return_inverse=True)

    def asked(self, queries):
        """Which of this rank's registered keys any rank asks for.

        Args:
            queries: (m,) int64 keys, repetition allowed.

        Returns:
            (n,) bool.
        """
        slot, found, _ = self._visit(queries)
        asked = np.zeros(len(self._distinct), dtype=bool)
        asked[slot[found]] = True
        return self._exchange.backward(asked[self._slot])

    def share(self, rows, given):
        """Let the ranks that know something of a key tell all ranks that registered it.

        Args:
            rows: (n, ...) what this rank says of each of its keys; ranks that say something say the same.
            given: (n,) bool, where this rank says something.

        Returns:
            (n, ...) rows as told by those who know, zero where nobody does, and (n,) bool whether somebody did.
        """
        table, known = self._table(rows, given)
        return self._exchange.backward(table[self._slot]), self._exchange.backward(known[self._slot])

    def lookup(self, queries, rows, given):
        """Ask for what the registering ranks know of any key; only what is asked for travels.

        Args:
            queries: (m,) int64 keys, repetition allowed.
            rows, given: as in `share`.

        Returns:
            (m, ...) rows, zero where nobody knows, and (m,) bool whether somebody does.
        """
        queries, back = np.unique(queries, return_inverse=True)
        slot, found, exchange = self._visit(queries)
        wanted = np.zeros(len(self._distinct), dtype=bool)
        wanted[slot[found]] = True
        table, known = self._table(rows, given & self._exchange.backward(wanted[self._slot]))
        found[found] = known[slot[found]]
        answer = np.zeros((len(slot), *table.shape[1:]), table.dtype)
        answer[found] = table[slot[found]]
        return exchange.backward(answer)[back], exchange.backward(found)[back]

    def lowest(self, values):
        """The lowest value that any rank gives to each key.

        Args:
            values: (n,) int64.

        Returns:
            (n,) int64.
        """
        values = self._exchange.forward(values)
        lowest = np.full(len(self._distinct), np.iinfo(np.int64).max)
        np.minimum.at(lowest, self._slot, values)
        return self._exchange.backward(lowest[self._slot])

    def number(self, active=None, claim=None, ballot=None):
        """Give each key one owner among the ranks that registered it, and number the keys owner by owner.

        Owners are drawn among the ranks with the highest claim by `ballot`, so that shared keys spread evenly, and
        two keys with the same claimants and the same ballot get the same owner.

        Args:
            active: (n,) bool, the keys to number (the same on all ranks that registered a key); default all.
            claim: (n,) int, larger wins the ownership; default equal.
            ballot: (n,) int64 non-negative, of the winning claimants; default the key itself.

        Returns:
            (n,) int64 global numbers, contiguous by owner and on each owner in the order of its keys (-1 where
            not active), and (n,) int32 owners.
        """
        n = len(self.keys)
        active = np.ones(n, dtype=bool) if active is None else active
        claim = np.zeros(n, dtype=np.int8) if claim is None else np.asarray(claim, dtype=np.int8)
        ballot = self.keys if ballot is None else ballot
        claim, ballot = self._exchange.forward(claim), self._exchange.forward(ballot)
        order = np.lexsort((self._exchange.source, -claim, self._slot))
        slot, claim, ballot = self._slot[order], claim[order], ballot[order]
        first = np.searchsorted(slot, np.arange(len(self._distinct)))
        winners = np.bincount(slot, weights=claim == claim[first][slot], minlength=len(first)).astype(np.int64)
        drawn = first + hashed(ballot[first], 2**31 - 1) % np.maximum(winners, 1)
        owner = self._exchange.backward(self._exchange.source[order[drawn]][self._slot].astype(np.int32))

        own = active & (owner == self.comm.rank)
        offset = self.comm.exscan(int(own.sum())) or 0
        numbers = np.full(n, -1, dtype=np.int64)
        numbers[own] = offset + np.arange(own.sum())
        if self.comm.size > 1:
            shared, known = self.share(numbers, own)
            numbers = np.where(known, shared, -1)
        return numbers, owner

    def _visit(self, queries):
        queries = np.asarray(queries, dtype=np.int64)
        exchange = Exchange(self.comm, self._home(queries))
        arrived = exchange.forward(queries)
        slot = np.searchsorted(self._distinct, arrived)
        slot[slot == len(self._distinct)] = 0
        found = self._distinct[slot] == arrived if len(self._distinct) else np.zeros(len(arrived), dtype=bool)
        return slot, found, exchange

    def _table(self, rows, given):
        """What is known of each key at home; only the rows that say something are sent there."""
        speaking = np.flatnonzero(given)
        exchange = Exchange(self.comm, self._at[speaking])
        slot = np.searchsorted(self._distinct, exchange.forward(self.keys[speaking]))
        rows = exchange.forward(np.asarray(rows)[speaking])
        table = np.zeros((len(self._distinct), *rows.shape[1:]), rows.dtype)
        known = np.zeros(len(self._distinct), dtype=bool)
        table[slot], known[slot] = rows, True
        return table, known
