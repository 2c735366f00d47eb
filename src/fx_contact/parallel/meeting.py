"""Calls that all ranks must make begin with a meeting, in which they agree on what is called.

Each rank tells rank 0 of the communicator what it calls; rank 0 compares and answers all.  A rank whose program ends
tells that instead, from an exit function that is registered when the package is imported.

The messages go from point to point, for a collective would be matched with those of PETSc, which begin when a program
ends.  They go over a duplicate of the user's communicator, where no receive of the user's gets them.  That of PETSc's
world is made when the package is imported, which is collective there as importing PETSc is; those of others once all
have agreed on a first call, which is over the communicator itself, with tags of its own.
"""

import atexit
import inspect
import logging
import sys
import time
import traceback
from contextlib import contextmanager
from functools import wraps

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fx_contact.parallel.errors import CallError

#: Seconds after which those who have not come are named.
_PATIENCE = 30.0
#: Seconds that a rank which fails alone, where others may wait for it inside a call, gives them before it aborts all.
_GRACE = 10.0
#: Seconds in which ranks that wait answer.
_PROMPT = 1.0
#: Tags of what a rank says, of rank 0's answer, and of questions who waits.
_SAID, _ANSWER, _ROLL = 1203, 1204, 1205
#: What a rank says when its program ends.
_END = "the end of the program"

_LOG = logging.getLogger("fx_contact")  # without a handler Python writes warnings to stderr; the user may change that
_all = []  # Meetings of this process
_keyval = None  # under which communicators keep theirs


def collective(comm, what=None):
    """Decorator: all ranks of a communicator must make this call; otherwise it raises CallError on all of them.

    Calls differ if their names do, or the numbers of the Steps.  Calls inside this one, and those on one rank, have no
    meeting of their own.

    Args:
        comm: where the communicator is: name of an argument, and of its attributes, "step.forest.comm".
        what: name of the call for errors; None: that of the function, or of the class that it makes.
    """
    argument, *attributes = comm.split(".")

    def decorate(function):
        """The function with its meeting."""
        name = what or function.__qualname__.removesuffix(".__init__")
        parameters = inspect.signature(function).parameters
        place, default = list(parameters).index(argument), parameters[argument].default

        @wraps(function)
        def call(*args, **kwargs):
            """The function after its meeting."""
            found = args[place] if place < len(args) else kwargs.get(argument, default)
            step = getattr(getattr(found, "record", None), "step", None)
            for attribute in attributes:
                found = getattr(found, attribute, None)
            with calling(found, name if step is None else f"{name} of step {step}"):
                return function(*args, **kwargs)

        return call

    return decorate


@contextmanager
def calling(comm, what):
    """A block that all ranks of a communicator must enter together, as `collective` has it.

    Collective on comm.

    Args:
        comm: MPI communicator; anything else has no meeting: the block will say what is wrong.
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


def expect_end():
    """From now on the others hear when the program of this rank ends; on one rank there are none.

    Collective on PETSc's world.  After PETSc is imported, for the last exit function that is registered comes first.
    """
    global _keyval
    if _keyval is None and MPI.COMM_WORLD.size > 1:
        _keyval = MPI.Comm.Create_keyval()
        atexit.register(leave)
        world = meetings_of(PETSc.COMM_WORLD.tompi4py())
        if world is not None:
            world.duplicate()


def leave(error=None):
    """Say that the program of this rank ends, and wait until that of the others does or has heard of it.

    Collective on the communicators whose ranks have agreed on a call before.  Where this rank ends by an error and the
    others do not come, as they wait for it in messages of their own, all are aborted.

    Args:
        error: that ends it; None: the one that Python has shown last, if any.
    """
    if MPI.Is_finalized():
        return
    error = error or getattr(sys, "last_value", None)
    said = f"{_END} by {type(error).__name__}" if error else _END
    left = [meetings for meetings in _all if not meetings.over and meetings.link != MPI.COMM_NULL]
    if any(meetings.torn for meetings in left):
        _abort("it was interrupted inside a call that all ranks must make")
    for meetings in left:
        meetings.say(said)
    known = [meetings for meetings in left if meetings.settle()]
    if not _wait(known, _GRACE if error else np.inf):
        _abort(f"it has come to {said}, and others do not answer")


def _abort(why):
    """End all ranks."""
    _LOG.error("rank %d ends all ranks: %s", MPI.COMM_WORLD.rank, why)
    MPI.COMM_WORLD.Abort(1)


def meetings_of(comm):
    """The Meetings of a communicator; None if it is none or has one rank.  Local."""
    if not isinstance(comm, MPI.Intracomm) or comm == MPI.COMM_NULL or comm.size == 1:
        return None
    known = comm.Get_attr(_keyval)
    if known is None:
        known = Meetings(comm)
        comm.Set_attr(_keyval, known)
        _all.append(known)
    return known


def _wait(meetings, limit=np.inf, watch=None):
    """Wait for the answers of some Meetings, up to a limit [s], and call `watch` meanwhile: bool, whether all came."""
    start, waiting = time.monotonic(), meetings
    while waiting := [one for one in waiting if one.answer() is None]:
        waited = time.monotonic() - start
        if waited > limit:
            return False
        if waited > 1e-4:  # a wait becomes longer by a tenth, and leaves the processor to others
            time.sleep(min(waited / 10, 0.05))
            if watch:
                watch(waited)
    return True


class Meetings:
    """The meetings of the ranks of a communicator, one after the other.

    Local when made.

    Args:
        comm: MPI communicator.

    Attributes:
        link: communicator of the messages; null where the user has freed it before all had agreed.
        inside: whether this rank is inside a call on which all have agreed.
        torn: whether it was interrupted there, or in a meeting: nobody can know then where the others are.
        over: whether there are no more meetings, as a rank has come to its end.
        own: whether `link` is a duplicate, which stays when the user frees the other.
        turns: how many exchanges over `link` there have been.
    """

    def __init__(self, comm):
        self.link, self.own, self.turns = comm, False, 0
        self._rank, self._size = comm.rank, comm.size
        self.inside, self.torn, self.over = False, False, False
        self._number, self._said, self._sent = 0, {}, []
        self._differ = None  # of rank 0: when the first two ranks differed in the present meeting
        self._last = None  # what the ranks said in the last meeting where they differed: dict, what -> ranks

    def agree(self, what):
        """See that all ranks make the same call.

        Collective on comm.

        Args:
            what: name of the call.

        Raises:
            CallError: they do not.
        """
        if not self.over:
            self.torn = True
            self.say(what)
            _wait([self], watch=_RollCall(self.link, self._number, what).turn)
            self.torn = False
        if self._last:
            late = {} if what in self._last else {what: [self._rank]}
            raise CallError(_sentence(self._last | late))
        if not self.own:
            self.duplicate()

    def duplicate(self):
        """Take a communicator of its own.  Collective on comm."""
        self.link, self.own = self.link.Dup(), True

    def fail(self, what, error):
        """Say that a call has failed on this rank.  If it has on all, that is all; others inside it are aborted.

        Collective on comm.

        Args:
            what: name of the call.
            error: that it raises.
        """
        self.say(f"an error in {what}")
        if not _wait([self], _GRACE):
            traceback.print_exception(error)
            _abort(f"{what} has failed on it alone")

    def say(self, what):
        """Tell rank 0 what this rank does.  Local: `answer` has to follow, until there is one."""
        if self._rank == 0:
            self._said[0] = what
        else:
            self._send(what, 0, _SAID)

    def answer(self):
        """What came out of the present meeting; then the next begins.

        Local.

        Returns:
            dict, what ranks say -> these ranks, empty if all say the same; None: they have not come yet.
        """
        answer = self._compared() if self._rank == 0 else self._received()
        if answer is not None:
            self._number, self._said, self._differ, self._last = self._number + 1, {}, None, answer
            if any(said.startswith(_END) for said in answer):
                self.over = True
            for _ in _messages(self.link, _ROLL):
                pass  # questions that were asked before this rank came
        return answer

    def settle(self):
        """bool: whether the others will answer, as they have met before; else they are told, and need not.  Local."""
        if self._number == 0 and self._rank == 0:
            self._tell({self._said[0]: [0]})
        return self._number > 0

    def _compared(self):
        """The answer, on rank 0, once all have come, or a second after two of them differed."""
        for source, (number, what) in _messages(self.link, _SAID):
            if number == self._number:
                self._said[source] = what
        ranks = {}
        for rank in sorted(self._said):
            ranks.setdefault(self._said[rank], []).append(rank)
        if len(self._said) < self._size:
            self._differ = self._differ or (time.monotonic() if len(ranks) > 1 else None)
            if not self._differ or time.monotonic() < self._differ + _PROMPT:
                return None
        answer = ranks if len(ranks) > 1 else {}
        self._tell(answer)
        return answer

    def _tell(self, answer):
        for rank in range(1, self._size):
            self._send(answer, rank, _ANSWER)

    def _received(self):
        """The answer of rank 0, if it has come."""
        for _, (number, answer) in _messages(self.link, _ANSWER):
            if number == self._number:
                return answer
        return None

    def _send(self, what, rank, tag):
        self._sent = [request for request in self._sent if not request.Test()]
        self._sent.append(self.link.isend((self._number, what), rank, tag))


def _messages(link, tag):
    """Messages that have come: (source, what was sent)."""
    status = MPI.Status()
    while link.Iprobe(MPI.ANY_SOURCE, tag, status):
        yield status.source, link.recv(source=status.source, tag=tag)


def _sentence(answer):
    """Error message on ranks that say different things."""
    said = ", ".join(f"{what} on {_ranks(ranks)}" for what, ranks in answer.items())
    return (
        f"all ranks must make the same calls in the same order, but they differ: {said}; "
        "take calls out of conditions on the rank, and let all ranks go on or none"
    )


def _ranks(ranks):
    """Ranks as a sentence has them."""
    text = ", ".join(map(str, ranks[:8]))
    return f"rank{'s' * (len(ranks) > 1)} {text}" + (f" and {len(ranks) - 8} more" if len(ranks) > 8 else "")


class _RollCall:
    """Who else waits in a meeting, asked once a rank has waited for long; then it names the others.

    Args:
        link: communicator.
        number: of the meeting.
        what: this rank calls.
    """

    def __init__(self, link, number, what):
        self._link, self._number, self._what = link, number, what
        self._here, self._asked, self._done, self._sent = {link.rank}, None, False, []

    def turn(self, waited):
        """Answer and ask.  Local.

        Args:
            waited: seconds so far.
        """
        for source, (number, asks) in _messages(self._link, _ROLL):
            if number == self._number and asks:
                self._send(source, False)
                self._done |= self._asked is None or source < self._link.rank  # who asked names them
            elif number == self._number:
                self._here.add(source)
        if self._done:
            return
        if self._asked is None and waited > _PATIENCE + 1e-3 * self._link.rank:  # one after the other: one will do
            self._asked = waited
            for rank in range(self._link.size):
                if rank != self._link.rank:
                    self._send(rank, True)
        elif self._asked is not None and waited > self._asked + _PROMPT:
            self._done = True
            late = _ranks([rank for rank in range(self._link.size) if rank not in self._here])
            _LOG.warning("waiting in %s for %s since %.0f s: all ranks must make this call", self._what, late, waited)

    def _send(self, rank, asks):
        self._sent.append(self._link.isend((self._number, asks), rank, _ROLL))
