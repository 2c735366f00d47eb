"""Text on records: a report of one step, and a table of the steps of a run.  All is local."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from fx_contact.items.units import unit_of
from fx_contact.parallel.validation import percent

if TYPE_CHECKING:
    from fx_contact.adaptive.step_record import StepRecord

#: Digits of the largest force; of others those with the same place value, the rest is the solver's error.
_DIGITS = 6
#: Least `pair_alignments` of a pair with one direction: its force is then the length of its force vector to 1 %.
DIRECTED = 0.99
#: Components shown as 0, relative to the sum of magnitudes: less than its digits.
_ROUNDING = 1e-6
#: Columns of the table: heading, width, and text of a record's value.
_COLUMNS: tuple[tuple[str, int, Callable[[StepRecord], str]], ...] = (
    ("step", 4, lambda r: str(r.step)),
    ("cells", 9, lambda r: f"{r.cells:,}"),
    ("dofs", 10, lambda r: f"{r.dofs:,}"),
    ("level", 5, lambda r: str(r.max_level)),
    ("order", 5, lambda r: str(r.geometry_order)),
    ("active", 7, lambda r: f"{r.active_pairs:,}"),
    ("contact", 7, lambda r: str(r.contact_iterations)),
    ("krylov", 6, lambda r: str(sum(r.krylov_iterations))),
    ("error %", 7, lambda r: f"{100 * r.estimate:.2f}"),
    ("eff.", 4, lambda r: f"{r.assumed_effectivity:.2f}"),
    ("force", 11, lambda r: f"{r.force:.5e}"),
    ("seconds", 7, lambda r: f"{r.seconds['total']:.2f}"),
)


def table_head() -> str:
    """Headings of `table_row`."""
    return "  ".join(name.rjust(width) for name, width, _ in _COLUMNS)


def table_row(record: StepRecord) -> str:
    """One line for one step."""
    return "  ".join(show(record).rjust(width) for _, width, show in _COLUMNS)


def html_table(caption: str, records: Sequence[StepRecord], values: Sequence[float] | None = None) -> str:
    """Table of the steps of a run, or of the points of a load path with their values, in HTML: as `table_row`."""
    rows = [[("th", name) for name, _, _ in _COLUMNS]]
    rows += [[("td", show(record)) for _, _, show in _COLUMNS] for record in records]
    if values is not None:
        first = [("th", "value"), *(("td", f"{value:.5g}") for value in values)]
        rows = [[cell, *row] for cell, row in zip(first, rows)]
    cells = ("".join(f"<{tag}>{escape(text)}</{tag}>" for tag, text in row) for row in rows)
    lines = "\n".join(f"<tr>{row}</tr>" for row in cells)
    return f"<table>\n<caption>{escape(caption)}</caption>\n{lines}\n</table>"


def report_text(record: StepRecord) -> str:
    """Mesh, error, contact, resultants, goals and warnings of a step; without its costs."""
    return "\n  ".join(_lines(record))


def costs(record: StepRecord) -> str:
    """A line on time and memory."""
    wall, cpu = record.seconds["total"], record.cpu_seconds["total"]
    return f"{wall:.1f} s of wall time, {cpu:.1f} s of CPU time, {record.peak_memory_bytes / 1e6:,.0f} MB of memory"


def _lines(r: StepRecord) -> Iterator[str]:
    """Lines of `report_text`."""
    yield f"step {r.step} of {r.scene!r} on {r.ranks} rank{'s' * (r.ranks > 1)}"
    yield f"{r.cells:,} cells of order {r.geometry_order}, up to level {r.max_level}"
    yield f"{r.dofs:,} unknowns of degree {r.degree}, {r.hanging_nodes:,} hanging nodes"
    reached = "" if r.reached else " not"
    yield f"estimated error {percent(r.estimate)}, tolerance {percent(r.tolerance)}{reached} reached"
    if r.pair_forces:
        largest = f"largest pressure {r.max_pressure:.5g}{_unit(r, 'stress')}"
        radius = f", contact radius {r.contact_radius:.5g}{_unit(r, 'length')}" if r.contact_radius else ""
        yield f"{r.active_pairs:,} contact nodes closed, {largest}{radius}"
    yield from _contacts(r)
    yield from _resultants(r)
    yield from map(str, r.goals)
    yield from (f"{warning.kind}: {warning.message}" for warning in r.doubts)
    yield from undirected(r)


def _contacts(r: StepRecord) -> Iterator[str]:
    """A line for each contact pair."""
    names = [one.name for one in r.resultants or () if one.kind == "contact"]
    for index, force in enumerate(r.pair_forces):
        error, moved = r.pair_errors[index], r.motions.get(names[index]) if names else None
        line = f"contact {repr(names[index]) if names else index}: "
        line += f"force {force:.6g}{_unit(r, 'force')}" if force else "open"
        line += "" if error is None else f", estimated error {percent(error)}"
        yield line + ("" if moved is None else f", obstacle moved by {moved:.5g}{_unit(r, 'length')}")


def _resultants(r: StepRecord) -> Iterator[str]:
    """A line for each tie, load and condition."""
    shown = [one for one in r.resultants or () if one.kind not in ("contact", "balance")]
    largest = max([r.force, *(abs(value) for one in shown for value in one.force)])
    digits = _DIGITS - 1 - int(np.floor(np.log10(largest))) if largest else 0
    for one in shown:
        motion = r.motions.get(one.name) if one.kind in ("tie", "rigid load") else None
        vector = ", ".join(f"{round(value, digits) + 0.0:.{_DIGITS}g}" for value in one.force)
        part = " on the modelled part" if one.kind == "symmetry" else ""
        yield f"{one.kind} {one.name!r}: force ({vector}){_unit(r, 'force')}{part}{_moved(r, motion)}"


def _moved(r: StepRecord, motion: float | list[float] | None) -> str:
    """The closing of a section, or the motion of a rigid face."""
    if motion is None:
        return ""
    if not isinstance(motion, list):
        return f", closed by {motion:.5g}{_unit(r, 'length')}"
    shift, turn = (", ".join(f"{value:.5g}" for value in part) for part in (motion[:3], motion[3:]))
    return f", moved by ({shift}){_unit(r, 'length')}, turned by ({turn}) rad"


def undirected(record: StepRecord) -> list[str]:
    """Lines on the contact pairs whose sum of magnitudes is more than the length of their force vector."""
    pairs = [one for one in record.resultants or () if one.kind == "contact"]
    lines = []
    for pair, force, alignment in zip(pairs, record.pair_forces, record.pair_alignments or ()):
        if alignment is not None and alignment < DIRECTED:
            vector = ", ".join(f"{0.0 if abs(value) < _ROUNDING * force else value:.5g}" for value in pair.force)
            lines.append(
                f"{pair.name!r} presses in many directions: its forces add up to ({vector}), {alignment:.1%} of the "
                "sum of their magnitudes"
            )
    return lines


def _unit(r: StepRecord, quantity: str) -> str:
    """Unit of a quantity behind a number, if it is known."""
    return f" {unit_of(quantity, r.units)}".rstrip()
