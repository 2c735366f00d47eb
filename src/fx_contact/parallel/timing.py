"""Costs of each stage of an adaptive step: wall and CPU seconds, memory; PETSc's `-log_view` has the same stages."""

import resource
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TypedDict

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fx_contact.parallel.arrays import FloatArray

#: Stages of an adaptive step, as the records name them; `other` is the remainder.
STAGES = tuple("compile partition mesh hanging assemble system setup solve estimate refine output other".split())
_STATM = Path("/proc/self/statm")


class Costs(TypedDict):
    """Entries of a step record.

    Wall time by stage and in total, the maximum over ranks; and sums over ranks: CPU time, resident memory at the end
    of each stage, 0 if not entered, and its maximum since the program began.
    """

    seconds: dict[str, float]
    cpu_seconds: dict[str, float]
    memory_bytes: dict[str, int]
    peak_memory_bytes: int


class Stages:
    """Costs by stage, exclusive of inner stages.  Local except for `costs`.

    Use: `with stages("mesh"): ...`.  In PETSc's log the stages are called "fx mesh", "fx assemble" and so on.

    Args:
        watch: called with the name of a stage when it begins and when an inner stage ends.
    """

    def __init__(self, watch: Callable[[str], None] | None = None) -> None:
        self._watch, self._logged, self._open = watch, _log_stages(), ["other"]
        self._spent = {name: np.zeros(2) for name in STAGES}
        self._memory = dict.fromkeys(STAGES, 0)
        self._start = self._since = _clocks()

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
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

    def _charge(self) -> None:
        """Add the time since the last change of stage to the innermost stage."""
        now = _clocks()
        self._spent[self._open[-1]] += now - self._since
        self._since = now

    def _tell(self) -> None:
        if self._watch and len(self._open) > 1:
            self._watch(self._open[-1])

    def costs(self, comm: MPI.Intracomm) -> Costs:
        """Costs so far.

        Collective on comm.
        """
        self._charge()
        wall, cpu = np.array([*self._spent.values(), self._since - self._start]).T.copy()
        comm.Allreduce(MPI.IN_PLACE, wall, op=MPI.MAX)
        comm.Allreduce(MPI.IN_PLACE, cpu, op=MPI.SUM)
        resident = [*(self._memory | {"other": _resident()}).values()]
        memory = np.array([*resident, max(_peak(), *resident)])  # the system's own peak lags a little
        comm.Allreduce(MPI.IN_PLACE, memory, op=MPI.SUM)
        names = [*STAGES, "total"]
        return {
            "seconds": dict(zip(names, map(float, wall))),
            "cpu_seconds": dict(zip(names, map(float, cpu))),
            "memory_bytes": dict(zip(STAGES, map(int, memory))),
            "peak_memory_bytes": int(memory[-1]),
        }


@cache
def _log_stages() -> dict[str, PETSc.Log.Stage]:
    """Stages of PETSc's log, made all at once, so that they are the same on every rank."""
    return {name: PETSc.Log.Stage(f"fx {name}") for name in STAGES if name != "other"}


def _clocks() -> FloatArray:
    return np.array([time.perf_counter(), time.process_time()])


def _resident() -> int:
    """Resident memory of this process [bytes]; its maximum so far if the system does not report it."""
    if _STATM.exists():
        return int(_STATM.read_text().split()[1]) * resource.getpagesize()
    return _peak()


def _peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
