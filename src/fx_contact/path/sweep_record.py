"""The points of a load path, as records and as files."""

import csv
import io
import json
import os
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Self

from mpi4py import MPI

from fx_contact.adaptive.step_record import StepRecord
from fx_contact.parallel.errors import OutputError, writing
from fx_contact.parallel.mpi import together

#: Columns of `sweep.csv` that are entries of the last step's record.
_OF_STEP = ("cells", "dofs", "estimate", "reached", "force", "max_pressure", "contact_radius", "max_penetration")


@dataclass(frozen=True, kw_only=True)
class SweepRecord:
    """The figures of one point of a load path, a line of `sweep.jsonl`.

    Attributes:
        point: number of the point, from 0.
        value: of the parameter.
        begun: "anew" on the root cells; on the "coarse" forest of the point before, or, of increments, as it was
            "before".
        solves: number of steps.
        unknowns: of all steps together.
        cpu_seconds: of the point, all ranks together, without its scene and compilation [s].
        record: StepRecord of the last step.
        dissipated_energy: by friction, of increments in all load steps so far [J]; None: no friction.
    """

    point: int
    value: float
    begun: str
    solves: int
    unknowns: int
    cpu_seconds: float
    record: StepRecord
    dissipated_energy: float | None = None

    def __str__(self) -> str:
        where = {"coarse": "on a coarse mesh", "before": "on the mesh before"}.get(self.begun, self.begun)
        begun = f"begun {where}, {self.solves} steps"
        head = f"point {self.point}, value {self.value:.6g}: {begun}, {self.cpu_seconds:.1f} s of CPU time"
        return f"{head}\n{self.record}"

    def as_json(self) -> dict[str, Any]:
        """The entries.  Local."""
        entries = asdict(self) | {"record": self.record.as_json()}
        return {name: value for name, value in entries.items() if value is not None}

    @classmethod
    def from_json(cls, entries: dict[str, Any]) -> Self:
        """A record from the entries of `as_json`.  Local.  Raises TypeError if one is missing."""
        known = {one.name: entries[one.name] for one in fields(cls) if one.name in entries}
        return cls(**known | {"record": StepRecord.from_json(entries["record"])})


def write_sweep(folder: Path, comm: MPI.Intracomm, points: list[SweepRecord]) -> None:
    """Write the points of a load path as `sweep.jsonl` and `sweep.csv` into an existing folder, replacing old ones.

    Collective on comm.  Raises OutputError if a file cannot be written.
    """
    with together(comm):
        if comm.rank == 0:
            lines = [json.dumps(point.as_json(), default=float) + "\n" for point in points]
            _replace(folder / "sweep.jsonl", "".join(lines))
            _replace(folder / "sweep.csv", _table(points))


def _replace(path: Path, text: str) -> None:
    """Replace a file by a renamed new one."""
    new = path.with_name(f"{path.name}.new")
    if path.exists() and not path.is_file():
        raise OutputError(f"{str(path)!r} is no file: remove it, or name another folder")
    with writing(path):
        new.write_text(text)
        os.replace(new, path)


def _table(points: list[SweepRecord]) -> str:
    columns = [one.name for one in fields(SweepRecord) if one.name not in ("record", "dissipated_energy")]
    columns += ["dissipated_energy"] * any(point.dissipated_energy is not None for point in points)
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow([*columns, *_OF_STEP])
    for point in points:
        table.writerow([getattr(point, name) for name in columns] + [getattr(point.record, n) for n in _OF_STEP])
    return text.getvalue()
