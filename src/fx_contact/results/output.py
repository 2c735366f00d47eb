"""Results on disk: step records as JSON lines, fields for ParaView."""

import json
import math
import os
from collections.abc import Sequence
from pathlib import Path

from mpi4py import MPI

from fx_contact.adaptive.step import Step, check_step
from fx_contact.adaptive.step_record import StepRecord
from fx_contact.parallel.agreement import shared_path
from fx_contact.parallel.errors import OutputError, writing
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.mpi import together
from fx_contact.parallel.validation import check_comm
from fx_contact.results.contact_surface import contact_grid
from fx_contact.results.vtu import write_grid

#: Entries that identify the record of a state, and their relative tolerance after solving for it again.
_TELLING, _SAME = ("cells", "dofs", "force", "estimate"), 1e-6


class RecordWriter:
    """Writer of `steps.jsonl` in a folder, created if missing: a step record per line, on disk as soon as written.

    Collective on comm.  `path` is that of the file.

    Args:
        finished: records of the steps before a restart.  With them the complete lines of the file are kept and missing
            ones added; without, the file starts empty.

    Raises:
        SceneError: comm is no communicator.
        OutputError: the folder cannot be created or written, or has records of other steps than `finished`.
    """

    @collective("comm")
    def __init__(self, folder: str | Path, comm: MPI.Intracomm, finished: Sequence[StepRecord] = ()) -> None:
        check_comm(comm)
        self.path = shared_path(comm, "the output folder", folder, OutputError, folder=True) / "steps.jsonl"
        self._comm = comm
        self._step: int | None = None  # last step written
        self._start = 0  # offset of its line
        with together(comm):
            if comm.rank == 0:
                with writing(self.path):
                    self._begin(finished)

    @collective("self._comm")
    def write(self, record: StepRecord) -> None:
        """Append a record, or replace the last one if it is of the same step.

        Collective on comm.  Raises OutputError if the file cannot be written.
        """
        with together(self._comm):
            if self._comm.rank == 0:
                with writing(self.path):
                    self._write(record)

    def _begin(self, finished: Sequence[StepRecord]) -> None:
        """Keep the complete lines of finished steps, and add missing ones."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        if self.path.exists() and not self.path.is_file():  # opening a pipe would block
            raise OutputError(f"{str(self.path)!r} is no file: remove it, or name another output folder")
        before = self.path.read_bytes() if finished and self.path.exists() else b""
        lines = before[: before.rfind(b"\n") + 1]
        there = [_step_of(line, finished) for line in lines.splitlines()]
        if None in there:
            raise OutputError(
                f"line {there.index(None) + 1} of {str(self.path)!r} is of another run, or of a step that the "
                "continued run has not done: name the output folder of that run, or a new one"
            )
        if not lines:
            self.path.write_bytes(b"")
        elif lines != before:
            os.truncate(self.path, len(lines))
        for record in finished:
            if record.step not in there:
                self._write(record)

    def _write(self, record: StepRecord) -> None:
        with self.path.open("rb+") as file:
            end = file.seek(0, os.SEEK_END)
            if record.step != self._step:
                self._step, self._start = record.step, end
            file.seek(self._start)
            file.write(json.dumps(record.as_json()).encode() + b"\n")
            file.truncate()


def _step_of(line: bytes, finished: Sequence[StepRecord]) -> int | None:
    """Number of the finished step whose record a line is, apart from its costs; None: it is of no such step."""
    try:
        entries = json.loads(line)
        known = next(record for record in finished if record.step == entries["step"])
        same = all(math.isclose(entries[name], getattr(known, name), rel_tol=_SAME) for name in _TELLING)
    except (ValueError, LookupError, TypeError, StopIteration):
        return None
    return known.step if same else None


@collective("step.forest.comm")
def write_fields(step: Step, folder: str | Path) -> None:
    """Write a step's fields for ParaView and pyvista, replacing existing files; needs pyvista.

    Collective.  `bodies.vtu` is `Step.to_pyvista`; `contact.vtu` has both sides of the contact surfaces, if there are
    any (`contact_grid`).  On several ranks these are `bodies.pvtu` and `contact.pvtu`, with a file a rank.  Raises
    SceneError for no step, SolveError as `Step.stress`, OutputError if a file cannot be written.
    """
    check_step(step)
    place = shared_path(step.forest.comm, "the output folder", folder, OutputError, folder=True)
    write_grid(step.forest.comm, place / "bodies", step.to_pyvista())
    if step.rows is not None:
        write_grid(step.forest.comm, place / "contact", contact_grid(step))
