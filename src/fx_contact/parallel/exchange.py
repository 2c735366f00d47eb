"""Exchange of array rows between ranks that know the destinations of their rows, but not the rows they will receive.

On few ranks the lengths and the rows are sent all to all.  On more ranks a rank communicates only with its partners,
found by a nonblocking consensus (T. Hoefler, C. Siebert, A. Lumsdaine, PPoPP 2010): lengths go by synchronous sends; a
rank whose sends have completed enters a barrier, and receives until all ranks have entered it.  One rank may then be an
exchange ahead of another, so two tags alternate.

Point-to-point messages go over the communicator of the meetings, where no receive of the user can match them.
"""

from typing import TypeVar

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fx_contact.parallel.arrays import Int32Array, Int64Array, IntArray
from fx_contact.parallel.meeting import meetings_of

Scalar = TypeVar("Scalar", bound=np.generic)

#: Largest number P of ranks with an exchange all to all and hashed homes: of 3 (P - 1) messages per rank, against 5 k
#: between k = 18 to 22 partners (studies/partition: 36 against 50 ms on 32 ranks, 89 against 51 ms on 64).
FEW_RANKS = 32
#: Tags of lengths, alternating, and of rows.
_LENGTHS, _ROWS = (1206, 1207), 1208


def few(comm: MPI.Intracomm) -> bool:
    """True on so few ranks that rows go all to all.  Local."""
    return comm.size <= max(FEW_RANKS, 1)


class Exchange:
    """Sparse all-to-all of array rows to destination ranks (n,), and its way back.

    Collective on comm.

    Attributes:
        source: (m,), rank that each received row came from, ascending.
    """

    def __init__(self, comm: MPI.Intracomm, destination: IntArray) -> None:
        ranks = np.asarray(destination)
        self.comm, self._order = comm, np.argsort(ranks, kind="stable")
        self._way: _AllToAll | _Partners
        self._way = _AllToAll(comm, ranks) if few(comm) else _Partners(comm, ranks[self._order])
        self.source = np.repeat(self._way.sources, self._way.received)

    @property
    def partners(self) -> Int32Array:
        """(k,), the other ranks that send rows here or receive rows from here, ascending.  Local."""
        ranks = np.union1d(self._way.targets, self.source)
        return ranks[ranks != self.comm.rank].astype(np.int32)

    def forward(self, rows: npt.NDArray[Scalar]) -> npt.NDArray[Scalar]:
        """Send rows (n, ...) to their destinations: (m, ...) by source rank, then as sent.  Collective on comm."""
        return self._way.moved(np.asarray(rows)[self._order])

    def backward(self, rows: npt.NDArray[Scalar]) -> npt.NDArray[Scalar]:
        """Send answers (m, ...) to the sources of the rows: (n, ...) in the order first sent.  Collective on comm."""
        answer = self._way.moved(np.asarray(rows), back=True)
        result = np.empty_like(answer)
        result[self._order] = answer
        return result


class _AllToAll:
    """Exchange by collective calls, of rows in the order of their destinations; attributes as in `_Partners`."""

    def __init__(self, comm: MPI.Intracomm, destination: IntArray) -> None:
        self._comm = comm
        self._sent = np.bincount(destination, minlength=comm.size).astype(np.int32)
        self.sources, self.received = np.arange(comm.size, dtype=np.int32), np.empty_like(self._sent)
        comm.Alltoall(self._sent, self.received)

    @property
    def targets(self) -> Int64Array:
        """(l,), ranks that receive rows, ascending."""
        return np.flatnonzero(self._sent)

    def moved(self, rows: npt.NDArray[Scalar], back: bool = False) -> npt.NDArray[Scalar]:
        """Received rows, or with `back` the answers to them."""
        if self._comm.size == 1:
            return rows
        sent, received = (self.received, self._sent) if back else (self._sent, self.received)
        rows, result, datatype = _buffers(rows, received.sum())
        self._comm.Alltoallv([rows, sent, datatype], [result, received, datatype])
        datatype.Free()
        return result


class _Partners:
    """Exchange from point to point between ranks that have rows for each other, in the order of their destinations.

    Attributes:
        sources, received: (k,), ranks that send rows here, ascending, and their numbers of rows.
        targets: (l,), ranks that receive rows, ascending.
    """

    def __init__(self, comm: MPI.Intracomm, destination: IntArray) -> None:
        meetings = meetings_of(comm)
        assert meetings is not None, "there is one on several ranks"
        meetings.turns, self._link = meetings.turns + 1, meetings.link
        self.targets, self._sent = np.unique(destination, return_counts=True)
        self.sources, self.received = _announced(self._link, _LENGTHS[meetings.turns % 2], self.targets, self._sent)

    def moved(self, rows: npt.NDArray[Scalar], back: bool = False) -> npt.NDArray[Scalar]:
        """As `_AllToAll.moved`."""
        there: tuple[IntArray, IntArray] = self.targets, self._sent
        here: tuple[IntArray, IntArray] = self.sources, self.received
        if back:
            there, here = here, there
        rows, result, datatype = _buffers(rows, here[1].sum())
        own: list[npt.NDArray[Scalar]] = []
        requests: list[MPI.Request] = []
        for array, (ranks, lengths), post in ((result, here, self._link.Irecv), (rows, there, self._link.Isend)):
            ends = np.cumsum(lengths)
            for rank, start, end in zip(map(int, ranks), map(int, ends - lengths), map(int, ends)):
                if rank == self._link.rank:
                    own.append(array[start:end])
                else:
                    requests.append(post([array[start:end], end - start, datatype], rank, _ROWS))
        if own:
            own[0][...] = own[1]
        MPI.Request.Waitall(requests)
        datatype.Free()
        return result


def _announced(
    link: MPI.Intracomm, tag: int, targets: IntArray, lengths: Int64Array
) -> tuple[Int32Array, Int64Array]:
    """Ranks that have rows for this one, ascending, and their numbers of rows; by the consensus of the module."""
    own, status = targets == link.rank, MPI.Status()
    barrier: MPI.Request | None = None
    found = dict(zip(map(int, targets[own]), map(int, lengths[own])))
    others = map(int, np.flatnonzero(~own))
    requests = [link.Issend(lengths[i : i + 1], int(targets[i]), tag) for i in others]
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
    ranks = sorted(found)
    return np.array(ranks, dtype=np.int32), np.array([found[rank] for rank in ranks], dtype=np.int64)


def _buffers(rows: npt.NDArray[Scalar], count: int) -> tuple[npt.NDArray[Scalar], npt.NDArray[Scalar], MPI.Datatype]:
    """Rows to send, a buffer for `count` received ones, and the MPI datatype of a row, to be freed."""
    rows = np.ascontiguousarray(rows)
    result = np.empty((count, *rows.shape[1:]), rows.dtype)
    width = rows.dtype.itemsize * int(np.prod(rows.shape[1:], dtype=np.int64))
    return rows, result, MPI.BYTE.Create_contiguous(width).Commit()
