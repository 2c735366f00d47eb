"""Rows of arrays exchanged between ranks, each of which knows where its rows go, and not what will come.

On few ranks all tell all how many rows will come, and rows go all to all.  On more ranks that is what grows with their
number; there a rank talks to its partners alone.  Who they are is found by a nonblocking consensus (T. Hoefler, C.
Siebert, A. Lumsdaine, PPoPP 2010): lengths go by synchronous sends; a rank whose own have arrived enters a barrier, and
takes what comes until all have entered it.  One may then be an exchange ahead of another, so that two tags take turns.

Messages from point to point go over the communicator of the meetings, where no receive of the user's gets them.
"""

import numpy as np
from mpi4py import MPI

from fx_contact.parallel.meeting import meetings_of

#: Most ranks P of an exchange all to all, whose keys are hashed.  With rows sent three times it takes a rank
#: log2 P + 3 (P - 1) messages, between k partners log2 P + 5 k.  The busiest of 64 ranks has k = 18 to 22, so that both
#: are alike at about 32 (studies/partition; by its exchanges.py 36 against 50 ms there, 89 against 51 on 64).
FEW_RANKS = 32
#: Tags of lengths, by turns, and of rows.
_LENGTHS, _ROWS = (1206, 1207), 1208


def few(comm):
    """bool: whether a communicator has so few ranks that rows go all to all.  Local."""
    return comm.size <= max(FEW_RANKS, 1)


class Exchange:
    """A sparse all-to-all of array rows, and its way back.

    Collective on comm.

    Args:
        comm: MPI communicator.
        destination: (n,) int, the rank that each row goes to.

    Attributes:
        source: (m,) int32, the rank that each received row came from, ascending.
    """

    def __init__(self, comm, destination):
        destination = np.asarray(destination)
        self.comm, self._order = comm, np.argsort(destination, kind="stable")
        self._way = _AllToAll(comm, destination) if few(comm) else _Partners(comm, destination[self._order])
        self.source = np.repeat(self._way.sources, self._way.received)

    @property
    def partners(self):
        """(k,) int32, the other ranks to which rows go or from which they come, ascending.  Local."""
        ranks = np.union1d(self._way.targets, self.source)
        return ranks[ranks != self.comm.rank].astype(np.int32)

    def forward(self, rows):
        """Send rows to their destinations.

        Collective on comm.

        Args:
            rows: (n, ...) array of any dtype.

        Returns:
            (m, ...) array, ordered by source rank, then as sent.
        """
        return self._way.forward(np.asarray(rows)[self._order])

    def backward(self, rows):
        """Send an answer to each received row back to where the row came from.

        Collective on comm.

        Args:
            rows: (m, ...) array in the order of `forward`'s result.

        Returns:
            (n, ...) array in the order of the rows first sent.
        """
        answer = self._way.backward(np.asarray(rows))
        result = np.empty_like(answer)
        result[self._order] = answer
        return result


class _AllToAll:
    """Rows in the order of their destinations, by collective calls.

    Collective on comm.

    Args:
        comm: MPI communicator.
        destination: (n,) int, in any order.

    Attributes:
        sources, received: (k,) int32, ranks from which rows come, ascending, and how many.
    """

    def __init__(self, comm, destination):
        self._comm = comm
        self._sent = np.bincount(destination, minlength=comm.size).astype(np.int32)
        self.sources, self.received = np.arange(comm.size, dtype=np.int32), np.empty_like(self._sent)
        comm.Alltoall(self._sent, self.received)

    @property
    def targets(self):
        """(l,) int64, ranks to which rows go, ascending.  Local."""
        return np.flatnonzero(self._sent)

    def forward(self, rows):
        """Rows as received.  Collective on comm."""
        return self._moved(rows, self._sent, self.received)

    def backward(self, rows):
        """Answers to them.  Collective on comm."""
        return self._moved(rows, self.received, self._sent)

    def _moved(self, rows, sent, received):
        if self._comm.size == 1:
            return rows
        rows, result, datatype = _buffers(rows, received.sum())
        self._comm.Alltoallv([rows, sent, datatype], [result, received, datatype])
        datatype.Free()
        return result


class _Partners:
    """The same from point to point, between ranks that have rows for each other.

    Collective on comm.

    Args:
        comm: MPI communicator.
        destination: (n,) int, ascending.

    Attributes:
        sources, received: (k,) int32 and (k,) int64, ranks from which rows come, ascending, and how many.
        targets: (l,) int64, ranks to which rows go, ascending.
    """

    def __init__(self, comm, destination):
        meetings = meetings_of(comm)
        meetings.turns, self._link = meetings.turns + 1, meetings.link
        self.targets, self._sent = np.unique(destination, return_counts=True)
        self.sources, self.received = _announced(self._link, _LENGTHS[meetings.turns % 2], self.targets, self._sent)

    def forward(self, rows):
        """Rows as received.  Collective on comm."""
        return self._moved(rows, (self.targets, self._sent), (self.sources, self.received))

    def backward(self, rows):
        """Answers to them.  Collective on comm."""
        return self._moved(rows, (self.sources, self.received), (self.targets, self._sent))

    def _moved(self, rows, there, here):
        rows, result, datatype = _buffers(rows, here[1].sum())
        own, requests = [], []
        for array, (ranks, lengths), post in ((result, here, self._link.Irecv), (rows, there, self._link.Isend)):
            ends = np.cumsum(lengths)
            for rank, start, end in zip(ranks.tolist(), (ends - lengths).tolist(), ends.tolist()):
                if rank == self._link.rank:
                    own.append(array[start:end])
                else:
                    requests.append(post([array[start:end], end - start, datatype], rank, _ROWS))
        if own:
            own[0][...] = own[1]
        MPI.Request.Waitall(requests)
        datatype.Free()
        return result


def _announced(link, tag, targets, lengths):
    """The ranks that have rows for this one: (k,) int32 ascending, and (k,) int64 how many.  Collective on link.

    Args:
        link: communicator.
        tag: of the messages.
        targets, lengths: (l,) int64, the ranks for which this one has rows, and how many.
    """
    own, status, barrier = targets == link.rank, MPI.Status(), None
    found = dict(zip(targets[own].tolist(), lengths[own].tolist()))
    requests = [
        link.Issend(lengths[i : i + 1], rank, tag) for i, rank in enumerate(targets.tolist()) if rank != link.rank
    ]
    while True:
        message = link.Improbe(MPI.ANY_SOURCE, tag, status)
        if message is not None:
            length = np.empty(1, dtype=np.int64)
            message.Recv(length)
            found[status.source] = int(length[0])
        elif barrier is None:
            if MPI.Request.Testall(requests):
                barrier = link.Ibarrier()
        elif barrier.Test():
            break
    ranks = np.array(sorted(found), dtype=np.int32)
    return ranks, np.array([found[rank] for rank in ranks.tolist()], dtype=np.int64)


def _buffers(rows, count):
    """Rows to send, room for so many to receive, and the MPI datatype of one, to be freed."""
    rows = np.ascontiguousarray(rows)
    result = np.empty((count, *rows.shape[1:]), rows.dtype)
    width = rows.dtype.itemsize * int(np.prod(rows.shape[1:], dtype=np.int64))
    return rows, result, MPI.BYTE.Create_contiguous(width).Commit()
