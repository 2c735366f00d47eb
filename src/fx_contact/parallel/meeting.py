"""Meetings: before a call that all ranks must make, they agree on its name; a rank whose program ends says so.

A meeting is a nonblocking reduction of the names' checksums over a duplicate of the user's communicator, where neither
messages of the user nor collective calls of PETSc, which begin when a program ends, can be taken for it.  The names
are brought together where they differ.  The duplicate for PETSc's world is made when the package is imported, where the
exit function is registered too: a rank that ends before its first call could not be told from a late one otherwise.
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
from typing import Any, ParamSpec, TypeVar, cast

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fx_contact.parallel.errors import CallError

#: Seconds after which those who have not come are named.
_PATIENCE = 30.0
#: Seconds in which ranks that wait have said so to each other, after that.
_PROMPT = 1.0
#: Seconds that a rank which fails alone, where others may wait for it inside a call, gives them before it aborts all.
_GRACE = 10.0
#: Tag of messages from ranks that wait.
_WAITING = 1203
#: What a rank says when its program ends.
_END = "the end of the program"

_LOG = logging.getLogger("fx_contact")  # without a handler Python writes warnings to stderr; the user may change that
_all: list["Meetings"] = []
_keyval = MPI.Comm.Create_keyval()  # under which communicators keep their Meetings

P = ParamSpec("P")
R = TypeVar("R")


def collective(comm: str, what: str | None = None) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorator: all ranks of a communicator must make this call; otherwise it raises CallError on all of them.

    Calls differ if their names do, or the numbers of the Steps.  Calls inside this one, and those on one rank, have no
    meeting of their own.

    Args:
        comm: place of the communicator: name of an argument, and of its attributes, "step.forest.comm".
        what: name of the call for errors; None: that of the function, or of the class that it makes.
    """
    argument, *attributes = comm.split(".")

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        """The function with its meeting."""
        name = what or function.__qualname__.removesuffix(".__init__")
        parameters = inspect.signature(function).parameters
        place, default = list(parameters).index(argument), parameters[argument].default

        @wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> R:
            """The function after its meeting."""
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
    """A block that all ranks of a communicator must enter together, as `collective` has it.

    Collective on comm.

    Args:
        comm: communicator; anything else has no meeting: the block will say what is wrong.
        what: name of the call.

    Raises:
        CallError: other ranks make another call, have failed in the one before, or have ended their program.
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
        meetings.fail(what, error)
        raise
    except BaseException:  # an interrupt: the others may be anywhere
        meetings.torn = True
        raise
    finally:
        meetings.inside = False


def expect_end() -> None:
    """From now on the others hear when the program of this rank ends; on one rank there are none.

    Collective on PETSc's world.  After PETSc is imported, for the last exit function that is registered comes first.
    """
    world = meetings_of(PETSc.COMM_WORLD.tompi4py())
    if world is not None and world.link:
        atexit.register(leave)


def leave(error: BaseException | None = None) -> None:
    """Say that the program of this rank ends, and wait until that of the others does or has heard of it.

    Collective on the communicators that have Meetings.  Where this rank ends by an error and the others do not come, as
    they wait for it in messages of their own, all are aborted.

    Args:
        error: that ends it; None: the one that Python has shown last, if any.
    """
    if MPI.Is_finalized():
        return
    error = error or getattr(sys, "last_value", None)
    said = f"{_END} by {type(error).__name__}" if error else _END
    left = [meetings for meetings in _all if not meetings.over]
    if any(meetings.torn for meetings in left):
        _abort("it was interrupted inside a call that all ranks must make")
    for meetings in left:
        meetings.say(said)
    if not _wait(left, _GRACE if error else np.inf):
        _abort(f"it has come to {said}, and others do not answer")


def _abort(why: str) -> None:
    """End all ranks."""
    _LOG.error("rank %d ends all ranks: %s", MPI.COMM_WORLD.rank, why)
    MPI.COMM_WORLD.Abort(1)


def meetings_of(comm: Any) -> "Meetings | None":
    """The Meetings of a communicator; None if it is none or has one rank.  Local."""
    if not isinstance(comm, MPI.Intracomm) or comm == MPI.COMM_NULL or comm.size == 1:
        return None
    known: Any = comm.Get_attr(_keyval)
    if known is None:
        known = Meetings(comm)
        comm.Set_attr(_keyval, known)
        _all.append(known)
    return cast(Meetings, known)


class Meetings:
    """The meetings of the ranks of a communicator, one after the other.

    Local when made.

    Attributes:
        inside: this rank is inside a call on which all have agreed.
        torn: it was interrupted there, or in a meeting: nobody can know then where the others are.
        over: a rank has come to its end; there are no more meetings.
        turns: number of exchanges over `link` so far.
    """

    def __init__(self, comm: MPI.Intracomm) -> None:
        self._comm, self._number = comm, 0
        self._link: MPI.Intracomm | None = None
        self._told: list[MPI.Request] | None = None  # messages to the others that this rank waits
        self.inside, self.torn, self.over, self.turns = False, False, False, 0
        self._difference = ""  # between the calls of the last meeting, as a sentence

    @property
    def link(self) -> MPI.Intracomm:
        """Duplicate of the communicator, for messages of this package alone.  Collective when first asked for."""
        if self._link is None:
            self._link = self._comm.Dup()
        return self._link

    def agree(self, what: str) -> None:
        """See that all ranks make the same call.

        Collective on comm.

        Raises:
            CallError: they do not.
        """
        if not self.over:
            self.torn = True
            self.say(what)
            _wait([self], name_late=True)
            self.torn = False
        if self._difference:
            raise CallError(self._difference)

    def fail(self, what: str, error: BaseException) -> None:
        """Say that a call has failed on this rank.  If it has on all, that is all; others inside it are aborted."""
        self.say(f"an error in {what}")
        if not _wait([self], _GRACE):
            traceback.print_exception(error)
            _abort(f"{what} has failed on it alone")

    def say(self, what: str) -> None:
        """Begin a meeting.  Local; it ends when `answered` says so."""
        self._what, self._lowest, self._told = what, np.empty(2, dtype=np.int64), None
        checksum = zlib.crc32(what.encode())
        self._request = self.link.Iallreduce(np.array([checksum, -checksum]), self._lowest, MPI.MIN)

    def answered(self) -> bool:
        """All ranks have come to the meeting, and it is known on what they agree."""
        if not self._request.Test():
            return False
        alike = self._lowest.sum() == 0  # the lowest checksum is the highest one
        said = [self._what] if alike else self.link.allgather(self._what)
        self._difference = "" if alike else _sentence(said)
        self._number, self.over = self._number + 1, any(what.startswith(_END) for what in said)
        return True

    def name_late(self, waited: float) -> None:
        """After so many seconds, let all who wait know of each other; then the lowest of them names the others."""
        rank, link = self.link.rank, self.link
        if self._told is None and waited > _PATIENCE:
            self._told = [link.isend(self._number, other, _WAITING) for other in range(link.size) if other != rank]
        if self._told and waited > _PATIENCE + _PROMPT:
            self._told, here, status = [], {rank}, MPI.Status()
            while link.Iprobe(MPI.ANY_SOURCE, _WAITING, status):
                if link.recv(source=status.source, tag=_WAITING) == self._number:
                    here.add(status.source)
            if min(here) == rank:
                late = _ranks([other for other in range(link.size) if other not in here])
                _LOG.warning(
                    "waiting in %s for %s since %.0f s: all ranks must make this call", self._what, late, waited
                )


def _wait(meetings: list[Meetings], limit: float = np.inf, name_late: bool = False) -> bool:
    """Wait for the answers of some Meetings, up to a limit [s]: bool, all have come."""
    start, waiting = time.monotonic(), meetings
    while waiting := [one for one in waiting if not one.answered()]:
        waited = time.monotonic() - start
        if waited > limit:
            return False
        if waited > 1e-4:  # a wait becomes longer by a tenth, and leaves the processor to others
            time.sleep(min(waited / 10, 0.05))
            for one in waiting if name_late else ():
                one.name_late(waited)
    return True


def _sentence(said: list[str]) -> str:
    """Error message on ranks that say different things, each its own."""
    calls = ", ".join(
        f"{what} on {_ranks([r for r, s in enumerate(said) if s == what])}" for what in dict.fromkeys(said)
    )
    return (
        f"all ranks must make the same calls in the same order, but they differ: {calls}; "
        "take calls out of conditions on the rank, and let all ranks go on or none"
    )


def _ranks(ranks: list[int]) -> str:
    text = ", ".join(map(str, ranks[:8]))
    return f"rank{'s' * (len(ranks) > 1)} {text}" + (f" and {len(ranks) - 8} more" if len(ranks) > 8 else "")
