"""The records in a folder of results, as a table, a report and pictures.  All is local."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mpi4py import MPI

from fx_contact.adaptive.step_record import StepRecord
from fx_contact.adaptive.step_report import table_head, table_row
from fx_contact.parallel.errors import OutputError
from fx_contact.path.sweep_record import SweepRecord
from fx_contact.plot import draw_convergence, draw_sweep

#: Files of records, and pictures that are made of them.
_RUN, _SWEEP = "steps.jsonl", "sweep.jsonl"
_CONVERGENCE, _CURVE = "convergence.png", "sweep.png"


def record_lines(folder: Path) -> Iterator[str]:
    """Table of the steps of a run or of the points of a load path, the last record, and the pictures of the folder.

    Draws `convergence.png` or `sweep.png` into the folder.

    Raises:
        OutputError: there are no records, a line is none, or a picture cannot be written.
    """
    if (folder / _SWEEP).is_file():
        points = [_made(SweepRecord, *one) for one in _entries(folder / _SWEEP)]
        steps = [point.record for point in points]
        drawn = points and draw_sweep(points, folder / _CURVE, MPI.COMM_SELF)
    elif (folder / _RUN).is_file():
        steps = [_made(StepRecord, *one) for one in _entries(folder / _RUN)]
        drawn = steps and draw_convergence(steps, folder / _CONVERGENCE, MPI.COMM_SELF)
    else:
        raise OutputError(
            f"no {_RUN} or {_SWEEP} in {str(folder)!r}: name the folder of a RecordWriter, or of a sweep"
        )
    if not drawn:
        raise OutputError(f"{str(folder)!r} has no record yet: no step is done")
    if (folder / _SWEEP).is_file():
        yield f"{'value':>12}  {table_head()}"
        yield from (f"{point.value:>12.6g}  {table_row(point.record)}" for point in points)
    else:
        yield table_head()
        yield from map(table_row, steps)
    yield ""
    yield str(steps[-1])
    yield from ("", "pictures:", *(f"  {path}" for path in sorted(folder.glob("*.png"))))


def _entries(path: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Place and entries of each complete line; the last may be in the making."""
    text = path.read_text()
    for number, line in enumerate(text[: text.rfind("\n") + 1].splitlines(), 1):
        place = f"line {number} of {str(path)!r}"
        try:
            yield place, json.loads(line)
        except ValueError as error:
            raise OutputError(f"{place} is no record: {error}") from error


def _made(kind: Any, place: str, entries: dict[str, Any]) -> Any:
    """A record from its entries."""
    try:
        return kind.from_json({**entries})
    except (TypeError, KeyError) as error:  # no object, or one without what a record has
        raise OutputError(f"{place} is no record of this version: {error}") from error
