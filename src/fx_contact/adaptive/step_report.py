"""Table of the records of a run's steps, or of a load path's points.  All is local."""

from collections.abc import Callable, Sequence
from html import escape

from fx_contact.adaptive.step_record import StepRecord

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
