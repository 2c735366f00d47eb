"""What each stage of an adaptive step costs: wall and CPU seconds, memory; PETSc's `-log_view` has the same stages."""

import resource
import time
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

#: Stages of an adaptive step, as they stand in the records; `other` is what none of them explains.
STAGES = tuple("compile partition mesh hanging assemble system setup solve estimate refine output other".split())
_STATM = Path("/proc/self/statm")


class Stages:
    """Costs by stage; a stage inside another is taken out of the outer one.  Local but for `costs`.

    In PETSc's log, as `-log_view` shows it, they are the stages "fx mesh", "fx assemble" and so on.

    Use: `with stages("mesh"): ...`.

    Args:
        watch: function of a stage's name, called when the stage begins and when work goes back to it; or None.
    """

    def __init__(self, watch=None):
        self._watch, self._logged, self._open = watch, _log_stages(), ["other"]
        self._spent = {name: np.zeros(2) for name in STAGES}
        self._memory = dict.fromkeys(STAGES, 0)
        self._start = self._since = _clocks()

    @contextmanager
    def __call__(self, name):
        self._charge()
        self._logged[name].push()
        self._open.append(name)
        self._tell()
        try:
            yield
        finally:
            self._charge()
            self._logged[name].pop()
            self._memory[name] = max(self._memory[name], _resident())
            self._open.pop()
            self._tell()

    def _charge(self):
        """The time since the last change of stage is that of the innermost stage, of "other" outside of all."""
        now = _clocks()
        self._spent[self._open[-1]] += now - self._since
        self._since = now

    def _tell(self):
        """Tell who watches of the innermost stage."""
        if self._watch and len(self._open) > 1:
            self._watch(self._open[-1])

    def costs(self, comm):
        """The costs so far, as they stand in the records.

        Collective on comm.

        Args:
            comm: MPI communicator.

        Returns:
            dict of `seconds` (by stage and `total`, wall, largest of the ranks), `cpu_seconds` (by stage and `total`,
            sum of the ranks), `memory_bytes` (by stage, resident at its end on all ranks together; 0 for a stage that
            was not entered) and `peak_memory_bytes` (of all ranks together, since the program began).
        """
        self._charge()
        wall, cpu = np.array([*self._spent.values(), self._since - self._start]).T.copy()
        comm.Allreduce(MPI.IN_PLACE, wall, op=MPI.MAX)
        comm.Allreduce(MPI.IN_PLACE, cpu, op=MPI.SUM)
        memory = [*(self._memory | {"other": _resident()}).values()]
        memory = np.array([*memory, max(_peak(), *memory)])  # the system's own peak lags a little
        comm.Allreduce(MPI.IN_PLACE, memory, op=MPI.SUM)
        names = [*STAGES, "total"]
        return {
            "seconds": dict(zip(names, wall.tolist())),
            "cpu_seconds": dict(zip(names, cpu.tolist())),
            "memory_bytes": dict(zip(STAGES, memory.tolist())),
            "peak_memory_bytes": int(memory[-1]),
        }


@cache
def _log_stages():
    """The stages in PETSc's log, all of them made at once, so that they are the same on every rank."""
    return {name: PETSc.Log.Stage(f"fx {name}") for name in STAGES if name != "other"}


def _clocks():
    """Wall and CPU seconds of this process."""
    return np.array([time.perf_counter(), time.process_time()])


def _resident():
    """Resident memory of this process [bytes]; where the system does not tell, the largest so far."""
    if _STATM.exists():
        return int(_STATM.read_text().split()[1]) * resource.getpagesize()
    return _peak()


def _peak():
    """Largest resident memory of this process so far [bytes]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
