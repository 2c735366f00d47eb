"""How much memory the hosts have left: large allocations are refused before the system kills the run."""

import ctypes
from pathlib import Path

import numpy as np
from mpi4py import MPI

from fx_contact.parallel.errors import SolveError

#: Bytes that a leaf of a forest takes while it is made and its nodes of degree 2 are numbered, as measured with 262,144
#: leaves of Hertz; of degree 1 they are 2,200, but a leaf's part of the matrix then takes as much as this.
_LEAF_BYTES = 8100

_MEMINFO = Path("/proc/meminfo")
#: The control group of this process (version 2: the line "0::PATH"), and where control groups are mounted.
_MEMBERSHIP, _CGROUP = Path("/proc/self/cgroup"), Path("/sys/fs/cgroup")


def check_leaves(comm, leaves):
    """See that there is memory for the leaves of a forest.

    Collective on comm.

    Args:
        comm: MPI communicator.
        leaves: how many this rank will have.

    Raises:
        SolveError: a host lacks it.
    """
    what = f"a forest of {comm.allreduce(leaves):,} leaves"
    check_memory(comm, what, _LEAF_BYTES * leaves, "refine less, ask for a larger tolerance, or use more hosts")


def give_back():
    """Give freed memory back to the system, which glibc keeps: up to 2.5 kB an unknown of the step before.  Local."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # other C libraries have none
    if trim is not None:
        trim(0)


def check_memory(comm, what, needed, advice):
    """See that there is memory for what comes next.

    Collective on comm.

    Args:
        comm: MPI communicator.
        what: needs it, for the message.
        needed: bytes that this rank will take.
        advice: what to do where it is not there.

    Raises:
        SolveError: a host lacks it.
    """
    short = shortage(comm, needed)
    if short is not None:
        needed, free = map(_size, short)
        raise SolveError(f"{what} needs {needed} on a host that has {free} left; {advice}")


def shortage(comm, needed):
    """The host that lacks most of the memory that is about to be taken.

    Collective on comm.

    Args:
        comm: MPI communicator.
        needed: bytes that this rank will take.

    Returns:
        (bytes needed, bytes free) of that host, the same on all ranks; None if all have enough, or do not tell.
    """
    host = comm.Split_type(MPI.COMM_TYPE_SHARED)
    needed, free = host.allreduce(int(needed)), host.allreduce(available(), op=MPI.MIN)
    host.Free()
    lacking, *worst = max(comm.allgather((needed - free, needed, free)))
    return tuple(worst) if lacking > 0 else None


def _size(count):
    """Bytes in the largest unit of which there is one at least: str.  Local."""
    unit, name = next((entry for entry in ((1e9, "GB"), (1e6, "MB")) if count >= entry[0]), (1e3, "kB"))
    return f"{count / unit:.1f} {name}"


def available():
    """Bytes that the host can still give, or the tightest control group (version 2) around this process.  Local.

    Returns:
        int or float, infinite where the system does not tell.
    """
    limits = [np.inf]
    try:
        limits.append(1024 * _table(_MEMINFO)["MemAvailable:"])
        own = Path(dict(line.split(":", 1) for line in _MEMBERSHIP.read_text().splitlines())["0"].lstrip(":/"))
    except (OSError, KeyError):
        own = Path()
    for group in (own, *own.parents):  # a batch system sets the limit of a job, of which each rank may be a group
        group = _CGROUP / group
        try:
            used = int((group / "memory.current").read_text()) - _table(group / "memory.stat")["inactive_file"]
            limits.append(int((group / "memory.max").read_text()) - used)
        except (OSError, KeyError, ValueError):  # not there, or "max"
            pass
    return max(min(limits), 0)


def _table(path):
    """A file of lines with a name and a number: dict of int.  Local."""
    return {name: int(number) for name, number, *_ in map(str.split, path.read_text().splitlines())}
