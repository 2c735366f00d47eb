"""Comparison of settings: between the ranks of a run, and with an earlier run."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from mpi4py import MPI

from fx_contact.parallel.errors import FxContactError, SceneError
from fx_contact.parallel.mpi import together
from fx_contact.parallel.validation import as_path


def check_alike(comm: MPI.Intracomm, settings: Mapping[str, Any]) -> None:
    """Raises SceneError, with the differences, unless all ranks have the same settings.

    Collective on comm.

    Args:
        settings: JSON values by name.
    """
    first = comm.bcast(settings)
    with together(comm):
        if differing := differences(first, settings, "on rank 0", f"on rank {comm.rank}"):
            raise SceneError(f"all ranks must be asked for the same, but they differ in {differing}")


def shared_path(
    comm: MPI.Intracomm,
    what: str,
    value: object,
    error: type[FxContactError] = SceneError,
    kind: Callable[[str, object, type[FxContactError]], Path] = as_path,
) -> Path:
    """The value as a path, the same on all ranks.

    Collective on comm.

    Args:
        what: its name in the message.
        kind: `as_path`, or `as_folder` for the path of a folder.

    Raises:
        SceneError: ranks differ.
        FxContactError: of the type `error`, if the value is no such path on some rank.
    """
    with together(comm):
        path = kind(what, value, error)
    check_alike(comm, {what: str(path)})
    return path


def differences(one: Mapping[str, Any], other: Mapping[str, Any], here: str, there: str) -> str:
    """Differences of two settings, JSON values by name, as part of a sentence; empty if there are none.  Local.

    The words `here` and `there` follow the values of each.
    """
    one, other = (json.loads(json.dumps(settings, default=float)) for settings in (one, other))
    return "; ".join(
        f"{name} ({_brief(one.get(name))} {here}, {_brief(other.get(name))} {there})"
        for name in {**one, **other}
        if not _alike(one.get(name), other.get(name))
    )


def _alike(one: Any, other: Any) -> bool:
    """Equal values; NaN is equal to NaN."""
    return one == other or json.dumps(one) == json.dumps(other)


def _brief(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 200 else text[:197] + "..."
