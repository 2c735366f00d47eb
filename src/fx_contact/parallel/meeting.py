"""Agreement of all ranks on the next collective call, and notice of ranks whose program ends.

A meeting is a nonblocking reduction of the checksums of the calls' names; if these differ, the names are gathered.  It
uses a duplicate of the user's communicator, apart from messages of the user and from PETSc's collectives at the end of
a program.  The meetings of PETSc's world begin at the import of the package: the end of a rank before its first call
is then distinguished from lateness.
"""

import atexit
import inspect
import logging
import sys
import time
import traceback
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fx_contact.parallel.errors import CallError

#: Waiting time after which the first two ranks, or one of them, tell that they wait [s].
_PATIENCE = 30.0
#: Waiting time of a rank that failed alone before it aborts all, since others may wait for it inside a call [s].
_GRACE = 10.0
#: Name of the last meeting of a rank, when its program ends.
_END = "the end of the program"

_LOG = logging.getLogger("fx_contact")  # without a handler Python writes warnings to stderr; the user may change that
_keyval = MPI.Comm.Create_keyval()  # attribute of the communicators that keeps their Meetings
_all: list["Meetings"] = []

P = ParamSpec("P")
R = TypeVar("R")


def collective(comm: str, what: str | None = None) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorator of a collective function.  Raises CallError on all ranks unless all of them call it.

    Calls differ if their names or the numbers of their Steps do.  Nested calls and calls on one rank have no meeting.

    Args:
        comm: place of the communicator: name of an argument, and of its attributes, "step.forest.comm".
        what: name of the call in errors; None: that of the function, or of the class for `__init__`.
    """
    argument, *attributes = comm.split(".")

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        """The function, which checks its calls."""
        name = what or function.__qualname__.removesuffix(".__init__")
        parameters = inspect.signature(function).parameters
        place, default = list(parameters).index(argument), parameters[argument].default

        @wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> R:
            """A checked call."""
            found: Any = args[place] if place < len(args) else kwargs.get(argument, default)
            step = getattr(getattr(found, "record", None), "step", None)
            for attribute in attributes:
                found = getattr(found, attribute, None)
            with calling(found, name if step is None else f"{name} of step {step}"):
                return function(*args, **kwargs)

        return call

    return decorate


@contextmanager
def calling(comm: Any, what: str) -> Iterator[None]:
    """Context of a collective call of a name, as for `collective`.

    Collective on comm.  Raises CallError if other ranks make another call, failed in the previous one, or have ended
    their program.  Anything but a communicator has no meeting: the call itself will raise an error.
    """
    meetings = meetings_of(comm)
    if meetings is None or meetings.inside:
        yield
        return
    meetings.agree(what)
    meetings.inside = True
    try:
        yield
    except (Exception, SystemExit) as error:
        meetings.begin(f"an error in {what}")
        if not _completed([meetings], _GRACE):
            traceback.print_exception(error)
            _abort(f"{what} has failed on it alone")
        raise
    finally:
        meetings.inside = False


def expect_end() -> None:
    """Notify the other ranks of the end of the program from now on.  Collective on PETSc's world."""
    meetings_of(PETSc.COMM_WORLD.tompi4py())


def leave(error: BaseException | None = None) -> None:
    """Notify the other ranks of the end of this rank's program, and wait until they have ended or taken note.

    Collective on the communicators that have Meetings.  If the program ends by an error, by default the last one that
    Python has printed, and the others do not answer, all ranks are aborted: they may wait in messages of their own.
    """
    if MPI.Is_finalized():
        return
    error = error or getattr(sys, "last_value", None)
    what = f"{_END} by {type(error).__name__}" if error else _END
    left = [meetings for meetings in _all if not meetings.ended]
    for meetings in left:
        meetings.begin(what)
    if not _completed(left, _GRACE if error else np.inf):
        _abort(f"it has come to {what}, and others do not answer")


def _abort(why: str) -> None:
    _LOG.error("rank %d ends all ranks: %s", MPI.COMM_WORLD.rank, why)
    MPI.COMM_WORLD.Abort(1)


def meetings_of(comm: Any) -> "Meetings | None":
    """The Meetings of a communicator; None for anything else, or for one rank.  Collective on comm at first use."""
    if not isinstance(comm, MPI.Intracomm) or comm == MPI.COMM_NULL or comm.size == 1:
        return None
    known: Meetings | None = comm.Get_attr(_keyval)  # type: ignore[assignment]
    if known is None:
        if not _all:
            atexit.register(leave)  # before PETSc's own, which is registered at its import
        known = Meetings(comm)
        comm.Set_attr(_keyval, known)
        _all.append(known)
    return known


class Meetings:
    """Successive meetings of the ranks of a communicator.

    Collective on comm.

    Attributes:
        link: duplicate of the communicator for messages of this package.
        inside: this rank is inside a call agreed by all.
        ended: the program of a rank has ended; there are no more meetings.
        turns: number of exchanges over `link` so far.
    """

    def __init__(self, comm: MPI.Intracomm) -> None:
        self.link, self.turns, self.inside, self.ended = comm.Dup(), 0, False, False
        self._begun: list[MPI.Request] = []  # several if an interrupt has ended the wait for one
        self._difference = ""  # between the calls of the last meeting, as a sentence

    def agree(self, what: str) -> None:
        """Raises CallError unless all ranks make the same call.  Collective on comm."""
        if not self.ended:
            self.begin(what)
            if not _completed([self], _PATIENCE):
                if self.link.rank < 2:
                    _LOG.warning(
                        "rank %d waits in %s since %g s: all ranks must make it", self.link.rank, what, _PATIENCE
                    )
                _completed([self])
        if self._difference:
            raise CallError(self._difference)

    def begin(self, what: str) -> None:
        """Begin a meeting.  Local; the meeting ends when `completed` is True."""
        self._what, self._lowest, checksum = what, np.empty(2, dtype=np.int64), zlib.crc32(what.encode())
        self._begun.append(self.link.Iallreduce(np.array([checksum, -checksum]), self._lowest, MPI.MIN))

    def completed(self) -> bool:
        """Test for completion, which determines the difference of the calls."""
        if self._begun and MPI.Request.Testall(self._begun):
            self._begun.clear()
            alike = self._lowest.sum() == 0  # the lowest checksum is the highest one
            calls = [self._what] if alike else self.link.allgather(self._what)
            self._difference = "" if alike else _sentence(calls)
            self.ended = any(what.startswith(_END) for what in calls)
        return not self._begun


def _completed(meetings: list[Meetings], limit: float = np.inf) -> bool:
    """Wait for the completion of meetings, up to a limit [s]; True if all are completed."""
    start = time.monotonic()
    while not all([one.completed() for one in meetings]):
        waited = time.monotonic() - start
        if waited > limit:
            return False
        if waited > 1e-4:  # the intervals grow by a tenth, and leave the processor to others
            time.sleep(min(waited / 10, 0.05))
    return True


def _sentence(calls: list[str]) -> str:
    named = ", ".join(
        f"{what} on {_ranks([rank for rank, call in enumerate(calls) if call == what])}"
        for what in dict.fromkeys(calls)
    )
    return (
        f"all ranks must make the same calls in the same order, but they differ: {named}; "
        "take calls out of conditions on the rank, and let all ranks go on or none"
    )


def _ranks(ranks: list[int]) -> str:
    text = ", ".join(map(str, ranks[:8]))
    return f"rank{'s' * (len(ranks) > 1)} {text}" + (f" and {len(ranks) - 8} more" if len(ranks) > 8 else "")
