"""Model problems that several tests share, and what keeps tests collective: ranks pass and fail together."""

import faulthandler
import os
import threading
import time
import traceback
import zlib
from collections.abc import Generator
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

WORLD = MPI.COMM_WORLD
#: Tests of more than `_SLOW` seconds, as `tests/run --note` has measured them.
SLOW = frozenset(Path(__file__).with_name("slow.txt").read_text().splitlines())
_SLOW = 1.0
#: Parts of names of slow tests that `tests/run` does not leave out: what the README runs, and a case of each feature.
_KEPT = (
    "README.md",
    "demos/hertz.py0]",
    "test_checkpoint.py::test_goes_on_as_if_not_stopped[1]",
    "test_contact_edge.py::test_integral_at_the_edge",
    "test_interior_point.py::test_same_solution_as_updates[degree 1]",
    "test_load_path.py::test_restart_in_the_middle",
    "test_preload.py::test_rod_between_walls[False-alike-2]",
    "test_rigid_loads.py::test_above_contact",
    "test_together.py::test_forces[1-2]",
    "test_watchdog.py::test_hang[waits]",
)


def pytest_addoption(parser):
    """How often the runs of `test_checkpoint` are killed, and how what takes long is run."""
    parser.addoption("--kills", type=int, default=2, help="times that a run is killed and restarted (default 2)")
    parser.addoption("--as-printed", action="store_true", help="run what the pages print to the letter, for hours")
    parser.addoption("--quick", action="store_true", help="leave out the tests of slow.txt")
    parser.addoption("--tenth", metavar="WORD", help="a tenth of the tests of slow.txt alone, drawn by this word")
    parser.addoption("--note", metavar="FILE", help="append the names of tests of more than a second to a file")
    parser.addoption("--limit", type=float, default=120.0, help="seconds of a test, five times as many of a slow one")
    parser.addoption("--spread", metavar="RANKS", default="", help="numbers of ranks of which one runs each test")


def pytest_configure(config):
    """The marks of these tests, and where the watchdog writes, which no test captures."""
    global _LOG
    _LOG = os.dup(2)
    config.addinivalue_line("markers", "ranks(*numbers): with --spread it runs on these numbers of ranks")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Leave out what the options say, after a check of slow.txt.

    With --spread a test runs on the ranks of its mark, if it skips some on those that it does not, else on one number
    by its name, a slow one on the first; one of `model_problems.lopsided` leaves on the last, it is none on one rank.
    """
    check_names(config.args, {item.nodeid for item in items})
    spread, word = [int(number) for number in config.getoption("--spread").split()], config.getoption("--tenth")

    def left_out(item):
        slow, mark = item.nodeid in SLOW, item.get_closest_marker("ranks")
        if slow and config.getoption("--quick") or word and not (slow and _crc(f"{word} {item.nodeid}") % 10 == 0):
            return True
        if not spread or (mark is None and item.get_closest_marker("skipif")):
            return False
        one = spread[0 if slow else _crc(item.nodeid) % len(spread)]
        if "lopsided" in item.name:
            one = spread[-1]
        return WORLD.size not in (mark.args if mark else [one])

    left = [left_out(item) for item in items]
    config.hook.pytest_deselected(items=[item for item, out in zip(items, left) if out])
    items[:] = [item for item, out in zip(items, left) if not out]


def _crc(text):
    return zlib.crc32(text.encode())


def check_names(arguments, collected):
    """Raise UsageError: slow.txt names what is no test of a file that is collected as a whole, or no file.

    On two ranks, where each test is that is on any number of them.
    """
    top, whole = Path(__file__).parents[1], {name.partition("::")[0] for name in collected}
    whole -= {file for file in whole if any(f"{file}::" in argument for argument in arguments)}
    whole |= {file for file in {name.partition("::")[0] for name in SLOW} if not (top / file).exists()}
    stale = sorted(name for name in SLOW - collected if name.partition("::")[0] in whole)
    if WORLD.size == 2 and stale:
        raise pytest.UsageError("\n".join(["tests/slow.txt names what is no test:", *stale]))


def pytest_sessionfinish(session, exitstatus):
    """A word that draws no test is in order."""
    if session.config.getoption("--tenth") and exitstatus == pytest.ExitCode.NO_TESTS_COLLECTED:
        session.exitstatus = pytest.ExitCode.OK


# ---------------------------------------------------------------------------------------- ranks pass and fail together

_MEETING = WORLD.Dup()
_PATIENCE = 60.0
"""Seconds that a rank which failed alone waits for the others, which may be stuck in a collective call."""
_LOG = 2
_BACKSTOP = 1.0
"""Seconds after the limit of a test when its rank ends even in C code that holds the lock of the interpreter."""


def everywhere(condition, message, comm=WORLD):
    """Assert on all ranks what must hold on each.  Collective on comm."""
    assert comm.allreduce(bool(condition), op=MPI.LAND), message


def _meet(failure, limit):
    """End a phase of a test together: the ranks that failed, or an abort if the others do not come."""
    failed = np.zeros(WORLD.size, dtype=np.int32)
    failed[WORLD.rank] = failure is not None
    total = np.empty_like(failed)
    request = _MEETING.Iallreduce(failed, total)
    deadline = time.monotonic() + min(_PATIENCE, limit / 2)
    while not request.Test():
        if failure is not None and time.monotonic() > deadline:
            os.write(_LOG, "".join(traceback.format_exception(failure)).encode())
            WORLD.Abort(1)
        time.sleep(1e-4)
    return np.flatnonzero(total)


def _together(item):
    failure, result = None, None
    try:
        result = yield
    except pytest.skip.Exception:
        _meet(None, _limit(item))
        raise
    except BaseException as caught:
        failure = caught
    failed = _meet(failure, _limit(item))
    if failure is not None:
        raise failure
    assert not len(failed), f"failed on ranks {failed.tolist()}"
    return result


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item):
    return (yield from _together(item))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    return (yield from _together(item))


@pytest.fixture
def folder(tmp_path):
    """One folder for all ranks."""
    return WORLD.bcast(tmp_path)


# ------------------------------------------------------------------------------------------------------ no test hangs


def _limit(item: pytest.Item) -> float:
    """Seconds that a test may take."""
    return item.config.getoption("--limit") * (5 if item.nodeid in SLOW else 1)


def _end(test: str, limit: float) -> None:
    """Name a test that does not end, show where this rank is, and end all ranks once they have done the same."""
    faulthandler.cancel_dump_traceback_later()
    os.write(_LOG, f"\n{test} does not end within {limit:g} s: rank {WORLD.rank} of {WORLD.size} is in\n".encode())
    faulthandler.dump_traceback(_LOG)
    time.sleep(2 * _BACKSTOP)
    os._exit(1)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Watch a test with its fixtures."""
    limit = _limit(item)
    timer = threading.Timer(limit, _end, (item.nodeid, limit))
    timer.daemon = True
    timer.start()
    faulthandler.dump_traceback_later(limit + _BACKSTOP, exit=True, file=_LOG)
    start = time.monotonic()
    try:
        return (yield)
    finally:
        timer.cancel()
        faulthandler.cancel_dump_traceback_later()
        _note(item, time.monotonic() - start)


def _note(item: pytest.Item, seconds: float) -> None:
    """Append the name of a slow test to the file of --note."""
    file = item.config.getoption("--note")
    if file and WORLD.rank == 0 and seconds > _SLOW and not any(name in item.nodeid for name in _KEPT):
        with Path(file).open("a") as notes:
            notes.write(item.nodeid + "\n")


def outside():
    """Environment for a program that is started from here, but does not belong to an mpirun above.  Local."""
    above = "OMPI_COMM", "OMPI_FILE", "OMPI_MCA_num", "OMPI_UNIVERSE", "OMPI_WORLD", "PMIX_", "PRTE_LAUNCHED"
    kept = {name: value for name, value in os.environ.items() if not name.startswith(above)}
    # More ranks than cores, folders where those of the mpirun above are: it has taken the launcher's settings away.
    policy = "rmaps_default_mapping_policy" if MPI.Get_library_version().startswith("Open MPI v5") else "mapby"
    kept |= {f"PRTE_MCA_{policy}": ":oversubscribe"}
    if "PMIX_SERVER_TMPDIR" in os.environ:
        kept |= {"PRTE_MCA_prte_tmpdir_base": os.path.dirname(os.environ["PMIX_SERVER_TMPDIR"])}
    return kept
