"""How much memory the hosts have left: large allocations are refused before the system ends the program for them."""

import resource
from pathlib import Path

import numpy as np
from mpi4py import MPI

from fx_contact.parallel.errors import SolveError

#: Bytes that a leaf of a forest takes while it is made and its vertices and edges are named, as measured.
_LEAF_BYTES = 1900

_MEMINFO, _STATM = Path("/proc/meminfo"), Path("/proc/self/statm")
#: The control groups of this process, and where they are.
_MEMBERSHIP, _CGROUP = Path("/proc/self/cgroup"), Path("/sys/fs/cgroup")
#: Of both versions of control groups, by the controllers in a line of the membership: folder below the mount, files of
#: the limit and of what is used, and the name of what the system takes back from the page cache at once.
_VERSIONS = {
    "": (".", "memory.max", "memory.current", "inactive_file"),
    "memory": ("memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
}


def check_leaves(comm, leaves):
    """See that there is memory for the leaves of a forest.

    Collective on comm.

    Args:
        comm: MPI communicator.
        leaves: how many this rank will have.

    Raises:
        SolveError: a host or a rank lacks it.
    """
    what = f"a forest of {comm.allreduce(leaves):,} leaves"
    check_memory(comm, what, _LEAF_BYTES * leaves, "refine less, ask for a larger tolerance, or use more hosts")


def check_memory(comm, what, needed, advice):
    """See that there is memory for what comes next.

    Collective on comm.

    Args:
        comm: MPI communicator.
        what: needs it, for the message.
        needed: bytes that this rank will take.
        advice: what to do where it is not there.

    Raises:
        SolveError: a host or a rank lacks it.
    """
    short = shortage(comm, needed)
    if short is not None:
        needed, free, place = short
        raise SolveError(f"{what} needs {_size(needed)} {place} that has {_size(free)} left; {advice}")


def shortage(comm, needed):
    """The host, or the rank under a limit of its own, that lacks most of the memory that is about to be taken.

    Collective on comm.

    Args:
        comm: MPI communicator.
        needed: bytes that this rank will take.

    Returns:
        (bytes needed, bytes free, where) of it, the same on all ranks; None if all have enough, or do not tell.
    """
    host = comm.Split_type(MPI.COMM_TYPE_SHARED)
    places = (
        (int(needed), address_space(), "on a rank under a limit (ulimit -v)"),
        (host.allreduce(int(needed)), host.allreduce(available(), op=MPI.MIN), "on a host"),
    )
    host.Free()
    worst = max(comm.allgather(max((needed - free, needed, free, place) for needed, free, place in places)))
    return worst[1:] if worst[0] > 0 else None


def _size(count):
    """Bytes in the largest unit of which there is one at least: str.  Local."""
    unit, name = next((entry for entry in ((1e9, "GB"), (1e6, "MB")) if count >= entry[0]), (1e3, "kB"))
    return f"{count / unit:.1f} {name}"


def available():
    """Bytes that this host, or a control group of this process, can still give.  Local.

    Returns:
        int or float, infinite where the system does not tell.
    """
    limits = [np.inf]
    try:
        lines = dict(line.split(":") for line in _MEMINFO.read_text().splitlines())
        limits.append(1024 * int(lines["MemAvailable"].split()[0]))
    except (OSError, KeyError, ValueError):
        pass
    for group, (_, limit, used, cache) in _groups():
        try:
            free = int((group / limit).read_text()) - int((group / used).read_text())
            kept = dict(line.split() for line in (group / "memory.stat").read_text().splitlines())
            limits.append(free + int(kept.get(cache, 0)))
        except (OSError, ValueError):  # not there, or "max"
            pass
    return max(min(limits), 0)


def _groups():
    """Folders of the control groups that this process is in, up to the outermost, and the names of their files."""
    try:
        lines = [line.split(":", 2) for line in _MEMBERSHIP.read_text().splitlines()]
    except OSError:
        return
    for _, controllers, path in lines:
        version = _VERSIONS.get(controllers)
        if version is not None:
            inner = Path(path.lstrip("/"))  # as the system names it, which inside a container need not be there
            for group in (inner, *inner.parents):
                yield _CGROUP / version[0] / group, version


def address_space():
    """Bytes that this process may still take by its own limit (ulimit -v).  Local.

    Returns:
        int or float, infinite where there is none.
    """
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit == resource.RLIM_INFINITY:
        return np.inf
    try:
        return max(limit - int(_STATM.read_text().split()[0]) * resource.getpagesize(), 0)
    except OSError:
        return limit
