"""The points of a load path, as records and as files."""

import csv
import io
import json
import os
from dataclasses import asdict, dataclass, fields

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
        begun: "anew" on the root cells, on the last point's forest "kept" where that was needed, or on a "coarse" one.
        solves: number of steps solved, with the one on a kept forest that did not do.
        unknowns: of all these solves together.
        cpu_seconds: of the point, all ranks together, without its scene and compilation [s].
        record: StepRecord of the last step.
    """

    point: int
    value: float
    begun: str
    solves: int
    unknowns: int
    cpu_seconds: float
    record: StepRecord

    def as_json(self):
        """The entries: dict.  Local."""
        return asdict(self) | {"record": self.record.as_json()}

    @classmethod
    def from_json(cls, entries):
        """A record from its entries.

        Local.

        Args:
            entries: dict, as `as_json` gives it.

        Raises:
            TypeError: an entry is missing.
        """
        known = {one.name: entries[one.name] for one in fields(cls) if one.name in entries}
        return cls(**known | {"record": StepRecord.from_json(entries["record"])})


def write_sweep(folder, comm, points):
    """Write the points of a load path as `sweep.jsonl` and `sweep.csv`, in the place of those that are there.

    Collective on comm; rank 0 writes.

    Args:
        folder: Path of a folder that is there.
        comm: MPI communicator.
        points: list of SweepRecord.

    Raises:
        OutputError: a file cannot be written.
    """
    with together(comm):
        if comm.rank == 0:
            lines = [json.dumps(point.as_json(), default=float) + "\n" for point in points]
            for name, text in (("sweep.jsonl", "".join(lines)), ("sweep.csv", _table(points))):
                _replace(folder / name, text)


def _replace(path, text):
    """Write a file beside the old one, then let it take its name.  Local."""
    new = path.with_name(f"{path.name}.new")
    if path.exists() and not path.is_file():
        raise OutputError(f"{str(path)!r} is no file: remove it, or name another folder")
    with writing(path):
        new.write_text(text)
        os.replace(new, path)


def _table(points):
    """The points as CSV: str."""
    columns = [one.name for one in fields(SweepRecord) if one.name != "record"]
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow([*columns, *_OF_STEP])
    for point in points:
        table.writerow([getattr(point, name) for name in columns] + [getattr(point.record, n) for n in _OF_STEP])
    return text.getvalue()
