"""Comparison of settings: between the ranks of a run, and with an earlier run."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from mpi4py import MPI

from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.mpi import together
from fx_contact.parallel.validation import as_path


def check_alike(comm: MPI.Intracomm, settings: Mapping[str, Any]) -> None:
    """See that all ranks are asked for the same.

    Collective on comm.

    Args:
        settings: what this rank is asked for by name, as JSON can hold it.

    Raises:
        SceneError: ranks differ; it says in what.
    """
    first = comm.bcast(settings)
    with together(comm):
        if differing := differences(first, settings, "on rank 0", f"on rank {comm.rank}"):
            raise SceneError(f"all ranks must be asked for the same, but they differ in {differing}")


def shared_path(
    comm: MPI.Intracomm,
    what: str,
    value: Any,
    error: type[Exception] = SceneError,
    kind: Callable[[str, Any, type[Exception]], Path] = as_path,
) -> Path:
    """A path from what the user gave, the same on all ranks.

    Collective on comm.

    Args:
        what: its name in the message.
        error: raised where it is no path.
        kind: `as_path`, or `as_folder` where files will be in it.

    Raises:
        SceneError, or the error given: it is none on some rank, or not the same on all.
    """
    with together(comm):
        path = kind(what, value, error)
    check_alike(comm, {what: str(path)})
    return path


def differences(one: Mapping[str, Any], other: Mapping[str, Any], here: str, there: str) -> str:
    """Entries in which two settings differ, as a sentence has them; empty if in none.  Local.

    Args:
        one, other: as JSON can hold them.
        here, there: what follows the values of each.
    """
    one, other = (json.loads(json.dumps(settings, default=float)) for settings in (one, other))
    return "; ".join(
        f"{name} ({_brief(one.get(name))} {here}, {_brief(other.get(name))} {there})"
        for name in {**one, **other}
        if not _alike(one.get(name), other.get(name))
    )


def _alike(one: Any, other: Any) -> bool:
    """Two values are equal, or written alike: NaN is not equal to itself."""
    return one == other or json.dumps(one) == json.dumps(other)


def _brief(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 200 else text[:197] + "..."
