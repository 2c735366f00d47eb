"""Settings compared: between the ranks of a run, which would wait for each other for ever, and with a run before."""

import json

from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.mpi import together
from fx_contact.parallel.validation import as_path


def check_alike(comm, settings):
    """See that all ranks are asked for the same.

    Collective on comm.

    Args:
        comm: MPI communicator.
        settings: dict that JSON can hold, what this rank is asked for by name.

    Raises:
        SceneError: ranks differ; it says in what.
    """
    first = comm.bcast(settings)
    with together(comm):
        if differing := differences(first, settings, "on rank 0", f"on rank {comm.rank}"):
            raise SceneError(f"all ranks must be asked for the same, but they differ in {differing}")


def shared_path(comm, what, value, error=SceneError, kind=as_path):
    """A path from what the user gave, the same on all ranks.

    Collective on comm.

    Args:
        comm: MPI communicator.
        what: it is, for the message.
        value: as given.
        error: type to raise where it is no path.
        kind: `as_path`, or `as_folder` where files will be in it.

    Returns:
        Path.

    Raises:
        SceneError, or the error given: it is none on some rank, or not the same on all.
    """
    with together(comm):
        path = kind(what, value, error)
    check_alike(comm, {what: str(path)})
    return path


def differences(one, other, here, there):
    """What two settings differ in, as a sentence has it; empty if in nothing.

    Local.

    Args:
        one, other: dict that JSON can hold.
        here, there: what follows the values of each.

    Returns:
        str.
    """
    one, other = (json.loads(json.dumps(settings, default=float)) for settings in (one, other))
    return "; ".join(
        f"{name} ({_brief(one.get(name))} {here}, {_brief(other.get(name))} {there})"
        for name in {**one, **other}
        if not _alike(one.get(name), other.get(name))
    )


def _alike(one, other):
    """Whether two values are equal, or written alike: NaN is not equal to itself."""
    return one == other or json.dumps(one) == json.dumps(other)


def _brief(value):
    text = json.dumps(value)
    return text if len(text) <= 200 else text[:197] + "..."
