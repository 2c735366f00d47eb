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
from fx_contact.parallel.validation import check_arguments

#: Waiting time after which late ranks are named, and time for the waiting ranks to notify each other after that [s].
_PATIENCE, _PROMPT = 30.0, 1.0
#: Waiting time of a rank that failed alone before it aborts all, since others may wait for it inside a call [s].
_GRACE = 10.0
#: Tag of the notices of waiting ranks.
_WAITING = 1203
#: Name of the last meeting of a rank, when its program ends.
_END = "the end of the program"

_LOG = logging.getLogger("fx_contact")  # without a handler Python writes warnings to stderr; the user may change that
_keyval = MPI.Comm.Create_keyval()  # attribute of the communicators that keeps their Meetings
_all: list["Meetings"] = []

P = ParamSpec("P")
R = TypeVar("R")


def collective(comm: str, what: str | None = None) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorator of a collective function.  Raises CallError on all ranks unless all of them call it.

    Raises SceneError for an argument by name that the function does not have (`check_arguments`).

    Calls differ if their names or the numbers of their Steps do.  Nested calls and calls on one rank have no meeting.

    Args:
        comm: place of the communicator: name of an argument, and of its attributes, "step.forest.comm".
        what: name of the call in errors; None: that of the function, or of the class for `__init__`.
    """
    argument, *attributes = comm.split(".")

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        """The function, which checks its calls."""
        name = what or function.__qualname__.removesuffix(".__init__")
        signature = inspect.signature(function)
        parameters = signature.parameters
        place, default = list(parameters).index(argument), parameters[argument].default

        @wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> R:
            """A checked call."""
            found: Any = args[place] if place < len(args) else kwargs.get(argument, default)
            step = getattr(getattr(found, "record", None), "step", None)
            for attribute in attributes:
                found = getattr(found, attribute, None)
            with calling(found, name if step is None else f"{name} of step {step}"):
                check_arguments(name, signature, args, kwargs)
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
        if not _wait([meetings], _GRACE):
            traceback.print_exception(error)
            _abort(f"{what} has failed on it alone")
        raise
    except BaseException:  # an interrupt: the others may be anywhere
        meetings.interrupted = True
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
    if any(meetings.interrupted for meetings in left):
        _abort("it was interrupted inside a call that all ranks must make")
    for meetings in left:
        meetings.begin(what)
    if not _wait(left, _GRACE if error else np.inf):
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
        interrupted: in a call or a meeting, so that the state of the other ranks is unknown.
        ended: the program of a rank has ended; there are no more meetings.
        turns: number of exchanges over `link` so far.
    """

    def __init__(self, comm: MPI.Intracomm) -> None:
        self.link, self.turns, self._number = comm.Dup(), 0, 0
        self.inside, self.interrupted, self.ended = False, False, False
        self._difference = ""  # between the calls of the last meeting, as a sentence

    def agree(self, what: str) -> None:
        """Raises CallError unless all ranks make the same call.  Collective on comm."""
        if not self.ended:
            self.interrupted = True
            self.begin(what)
            _wait([self], name_late=True)
            self.interrupted = False
        if self._difference:
            raise CallError(self._difference)

    def begin(self, what: str) -> None:
        """Begin a meeting.  Local; the meeting ends when `completed` is True."""
        self._what, self._lowest, self._notices = what, np.empty(2, dtype=np.int64), list[MPI.Request]()
        checksum = zlib.crc32(what.encode())
        self._request = self.link.Iallreduce(np.array([checksum, -checksum]), self._lowest, MPI.MIN)

    def completed(self) -> bool:
        """Test for completion, which determines the difference of the calls."""
        if not self._request.Test():
            return False
        alike = self._lowest.sum() == 0  # the lowest checksum is the highest one
        calls = [self._what] if alike else self.link.allgather(self._what)
        self._difference = "" if alike else _sentence(calls)
        self._number, self.ended = self._number + 1, any(what.startswith(_END) for what in calls)
        return True

    def name_late(self, waited: float) -> bool:
        """After long waiting [s] notify the other ranks; the lowest waiting rank then names the rest.  True: done."""
        rank, others = self.link.rank, set(range(self.link.size)) - {self.link.rank}
        if not self._notices and waited > _PATIENCE:
            self._notices = [self.link.isend(self._number, other, _WAITING) for other in others]
        if waited <= _PATIENCE + _PROMPT:
            return False
        late, status = others, MPI.Status()
        while self.link.Iprobe(MPI.ANY_SOURCE, _WAITING, status):
            if self.link.recv(source=status.source, tag=_WAITING) == self._number:
                late = late - {status.source}
        if rank < min(others - late, default=rank + 1):
            since = f"{_ranks(sorted(late))} since {waited:.0f} s: all ranks must make this call"
            _LOG.warning("waiting in %s for %s", self._what, since)
        return True


def _wait(meetings: list[Meetings], limit: float = np.inf, name_late: bool = False) -> bool:
    """Wait for the completion of meetings, up to a limit [s]; True if all are completed."""
    start, named = time.monotonic(), not name_late
    while meetings := [one for one in meetings if not one.completed()]:
        waited = time.monotonic() - start
        if waited > limit:
            return False
        if waited > 1e-4:  # the intervals grow by a tenth, and leave the processor to others
            time.sleep(min(waited / 10, 0.05))
            named = named or meetings[0].name_late(waited)
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
