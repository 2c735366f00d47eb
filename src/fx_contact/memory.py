"""How much memory the hosts have left: large allocations are refused before the system ends the program for them."""

from pathlib import Path

import numpy as np
from mpi4py import MPI

_MEMINFO, _CGROUP = Path("/proc/meminfo"), Path("/sys/fs/cgroup")


def shortage(comm, needed):
    """The host that lacks most of the memory that its ranks are about to take.

    Collective on comm.

    Args:
        comm: MPI communicator.
        needed: bytes that this rank will take.

    Returns:
        (bytes needed, bytes free) of that host, the same on all ranks; None if all hosts have enough, or do not tell.
    """
    host = comm.Split_type(MPI.COMM_TYPE_SHARED)
    needed, free = host.allreduce(int(needed)), host.allreduce(available(), op=MPI.MIN)
    host.Free()
    worst = max(comm.allgather((needed - free, needed, free)))
    return worst[1:] if worst[0] > 0 else None


def available():
    """Bytes that this host, or the control group of this process, can still give.  Local.

    Returns:
        int or float, infinite where the system does not tell.
    """
    limits = [np.inf]
    try:
        lines = dict(line.split(":") for line in _MEMINFO.read_text().splitlines())
        limits.append(1024 * int(lines["MemAvailable"].split()[0]))
    except (OSError, KeyError, ValueError):
        pass
    try:
        limits.append(int((_CGROUP / "memory.max").read_text()) - int((_CGROUP / "memory.current").read_text()))
    except (OSError, ValueError):  # not there, or "max"
        pass
    return max(min(limits), 0)
