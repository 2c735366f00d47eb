"""Comparison of settings: between the ranks of a run, and with an earlier run."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mpi4py import MPI

from fx_contact.parallel.errors import FxContactError, SceneError
from fx_contact.parallel.mpi import together
from fx_contact.parallel.validation import as_folder, as_path


def check_alike(comm: MPI.Intracomm, settings: Mapping[str, Any]) -> None:
    """Raises SceneError, with the differences, unless all ranks have the same settings, JSON values by name.

    Collective on comm.
    """
    first = comm.bcast(settings)
    with together(comm):
        if differing := differences(first, settings, "on rank 0", f"on rank {comm.rank}"):
            raise SceneError(f"all ranks must be asked for the same, but they differ in {differing}")


def shared_path(
    comm: MPI.Intracomm, what: str, value: object, error: type[FxContactError] = SceneError, folder: bool = False
) -> Path:
    """The value, called `what` in errors, as a path, of a folder if so required; the same on all ranks.

    Collective on comm.  Raises SceneError if ranks differ, and the error given if the value is no such path.
    """
    with together(comm):
        path = (as_folder if folder else as_path)(what, value, error)
    check_alike(comm, {what: str(path)})
    return path


def differences(one: Mapping[str, Any], other: Mapping[str, Any], here: str, there: str) -> str:
    """Differences of two settings, JSON values by name, as part of a sentence; empty if there are none.  Local.

    The words `here` and `there` follow the values of each.
    """
    one, other = (json.loads(json.dumps(settings, default=float)) for settings in (one, other))
    pairs = [(name, one.get(name), other.get(name)) for name in {**one, **other}]
    texts = [(name, json.dumps(a), json.dumps(b)) for name, a, b in pairs if a != b]
    return "; ".join(f"{name} ({_brief(a)} {here}, {_brief(b)} {there})" for name, a, b in texts if a != b)  # NaN


def _brief(text: str) -> str:
    return text if len(text) <= 200 else text[:197] + "..."
