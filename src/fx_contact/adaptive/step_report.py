"""Table of the records of a run's steps, or of a load path's points.  All is local."""

import sys
from collections.abc import Callable

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


def print_row(record: StepRecord, first: bool) -> None:
    """Print the row of a step on standard error, the first one below the headings."""
    print(f"{table_head()}\n" * first + table_row(record), file=sys.stderr, flush=True)
