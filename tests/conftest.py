"""Model problems that several tests share, and what keeps tests collective: ranks pass and fail together."""

import os
import sys
import time
import traceback

import numpy as np
import pytest
from mpi4py import MPI

WORLD = MPI.COMM_WORLD


def pytest_addoption(parser):
    """How often the runs of `test_checkpoint` are killed, and how what takes long is run."""
    parser.addoption("--kills", type=int, default=2, help="times that a run is killed and restarted (default 2)")
    parser.addoption("--as-printed", action="store_true", help="run what the README prints to the letter, for hours")
    parser.addoption("--in-turn", action="store_true", help="of whole runs, half on 2 and half on 3 ranks")


#: Modules whose tests are whole adaptive runs, most of the time on 2 and 3 ranks.
WHOLE_RUNS = {
    "test_accuracy",
    "test_contact_goals",
    "test_enforcement",
    "test_hertz",
    "test_ready_scenes",
    "test_inter_node_contact",
}


def pytest_collection_modifyitems(config, items):
    """With `--in-turn` each test of `WHOLE_RUNS` runs on 1 rank and on 2 or 3, every other one on each."""
    if not config.getoption("--in-turn") or WORLD.size not in (2, 3):
        return
    long = [item for item in items if item.module.__name__ in WHOLE_RUNS]
    left = set(long[WORLD.size % 2 :: 2])
    config.hook.pytest_deselected(items=sorted(left, key=items.index))
    items[:] = [item for item in items if item not in left]


def pytest_sessionfinish(session, exitstatus):
    """Where the arguments of `tests/run` select no test, its run on a number of ranks has not failed."""
    if exitstatus == pytest.ExitCode.NO_TESTS_COLLECTED:
        session.exitstatus = pytest.ExitCode.OK


# ---------------------------------------------------------------------------------------- ranks pass and fail together

_MEETING = WORLD.Dup()
_PATIENCE = 60.0
"""Seconds that a rank which failed alone waits for the others, which may be stuck in a collective call."""


def everywhere(condition, message, comm=WORLD):
    """Assert on all ranks what must hold on each.  Collective on comm."""
    assert comm.allreduce(bool(condition), op=MPI.LAND), message


def _meet(failure):
    """End a phase of a test together: the ranks that failed, or an abort if the others do not come."""
    failed = np.zeros(WORLD.size, dtype=np.int32)
    failed[WORLD.rank] = failure is not None
    total = np.empty_like(failed)
    request = _MEETING.Iallreduce(failed, total)
    deadline = time.monotonic() + _PATIENCE
    while not request.Test():
        if failure is not None and time.monotonic() > deadline:
            traceback.print_exception(failure, file=sys.__stderr__)
            sys.__stderr__.flush()
            WORLD.Abort(1)
        time.sleep(1e-4)
    return np.flatnonzero(total)


def _together():
    failure, result = None, None
    try:
        result = yield
    except pytest.skip.Exception:
        _meet(None)
        raise
    except BaseException as caught:
        failure = caught
    failed = _meet(failure)
    if failure is not None:
        raise failure
    assert not len(failed), f"failed on ranks {failed.tolist()}"
    return result


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item):
    return (yield from _together())


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    return (yield from _together())


def outside():
    """Environment for a program that is started from here, but does not belong to an mpirun above.  Local."""
    above = "OMPI_COMM", "OMPI_FILE", "OMPI_MCA_num", "OMPI_UNIVERSE", "OMPI_WORLD", "PMIX_", "PRTE_LAUNCHED"
    kept = {name: value for name, value in os.environ.items() if not name.startswith(above)}
    # More ranks than cores, folders where those of the mpirun above are: it has taken the launcher's settings away.
    kept |= {"PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe"}
    if "PMIX_SERVER_TMPDIR" in os.environ:
        kept |= {"PRTE_MCA_prte_tmpdir_base": os.path.dirname(os.environ["PMIX_SERVER_TMPDIR"])}
    return kept
