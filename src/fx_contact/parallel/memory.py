"""Memory of the hosts: large allocations are refused before the operating system kills the run."""

import ctypes
from pathlib import Path

import numpy as np
from mpi4py import MPI

from fx_contact.parallel.errors import SolveError

#: Peak bytes per leaf while a forest is made and its nodes of degree 2 are numbered, measured with 262,144 leaves of
#: Hertz.  At degree 1 it is 2,200, but a leaf's part of the matrix then needs as much as this.
_LEAF_BYTES = 8100

_MEMINFO = Path("/proc/meminfo")
#: Control group of this process (version 2: the line "0::PATH"), and the mount point of control groups.
_MEMBERSHIP, _CGROUP = Path("/proc/self/cgroup"), Path("/sys/fs/cgroup")


def check_leaves(comm: MPI.Intracomm, leaves: int) -> None:
    """Raises SolveError if a host lacks memory for the leaves of a forest, given for this rank.  Collective on comm."""
    what = f"a forest of {comm.allreduce(leaves):,} leaves"
    check_memory(comm, what, _LEAF_BYTES * leaves, "refine less, ask for a larger tolerance, or use more hosts")


def give_back() -> None:
    """Return freed memory to the system, up to 2.5 kB per unknown of the last step, which glibc retains.  Local."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # other C libraries have none
    if trim is not None:
        trim(0)


def check_memory(comm: MPI.Intracomm, what: str, needed: float, advice: str) -> None:
    """Raises SolveError if a host lacks memory for the bytes that its ranks are about to allocate.

    Collective on comm.  The message begins with `what`.
    """
    short = shortage(comm, needed)
    if short is not None:
        wanted, free = map(_size, short)
        raise SolveError(f"{what} needs {wanted} on a host that has {free} left; {advice}")


def shortage(comm: MPI.Intracomm, needed: float) -> tuple[float, float] | None:
    """Bytes needed and bytes free on the host with the largest lack of memory; None if all have enough.

    Collective on comm.
    """
    host = comm.Split_type(MPI.COMM_TYPE_SHARED)
    needed, free = host.allreduce(int(needed)), host.allreduce(available(), op=MPI.MIN)
    host.Free()
    lacking, needed, free = max(comm.allgather((needed - free, needed, free)))
    return (needed, free) if lacking > 0 else None


def _size(count: float) -> str:
    """Bytes in the largest unit that gives at least 1."""
    unit, name = next((entry for entry in ((1e9, "GB"), (1e6, "MB")) if count >= entry[0]), (1e3, "kB"))
    return f"{count / unit:.1f} {name}"


def available() -> float:
    """Free bytes of the host, or of the tightest control group (version 2); infinite if not reported.  Local."""
    limits: list[float] = [np.inf]
    try:
        limits.append(1024 * _table(_MEMINFO)["MemAvailable:"])
        own = Path(dict(line.split(":", 1) for line in _MEMBERSHIP.read_text().splitlines())["0"].lstrip(":/"))
    except (OSError, KeyError):
        own = Path()
    for group in (own, *own.parents):  # a batch system limits the job, and each rank may be a group in it
        group = _CGROUP / group
        try:
            used = int((group / "memory.current").read_text()) - _table(group / "memory.stat")["inactive_file"]
            limits.append(int((group / "memory.max").read_text()) - used)
        except (OSError, KeyError, ValueError):  # no such file, or "max"
            pass
    return max(min(limits), 0)


def _table(path: Path) -> dict[str, int]:
    """Lines of a name and a number."""
    return {name: int(number) for name, number, *_ in map(str.split, path.read_text().splitlines())}
