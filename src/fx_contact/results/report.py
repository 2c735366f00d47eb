"""Text on a run: a table of its steps, warnings on forces, doubts, seconds by stage.  Local."""

from fx_contact.parallel.timing import STAGES

#: Columns of the progress table: heading, width, and how to print a record's value.
_COLUMNS = (
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


def table_head():
    """The headings of `table_row`."""
    return "  ".join(name.rjust(width) for name, width, _ in _COLUMNS)


def table_row(record):
    """One line for one step record.

    Args:
        record: StepRecord.
    """
    return "  ".join(show(record).rjust(width) for _, width, show in _COLUMNS)


def force_warnings(record):
    """Warnings on contact pairs whose force has a larger error than the tolerance.

    The control of errors does not refine for forces below tolerance^2 times the largest (`ErrorControl`).

    Args:
        record: StepRecord of the last step.
    """
    lines = []
    for index, (force, error) in enumerate(zip(record.pair_forces, record.pair_errors)):
        if force and (error or 0) > record.tolerance:
            lines.append(
                f"contact pair {index}: the estimated error of its force is {min(error, 1):.0%}; no leaf is refined "
                "for forces below the square of the tolerance times the largest"
            )
    return lines


def doubt_lines(record):
    """What is doubtful about a solution, a line each.

    Args:
        record: StepRecord of the last step.
    """
    return [f"{doubt.kind}: {doubt.message}" for doubt in record.doubts]


def total_seconds(steps):
    """One line with the wall time of a run, its six longest stages, and the time of compilation.

    Args:
        steps: the `seconds` of the step records.
    """
    total = {name: sum(seconds[name] for seconds in steps) for name in (*STAGES, "total")}
    compiled = total.pop("compile")
    largest = sorted((name for name in total if name != "total"), key=total.get, reverse=True)[:6]
    parts = ", ".join(f"{name} {total[name]:.1f}" for name in largest)
    return f"{total['total'] - compiled:.1f} s ({parts}) and {compiled:.1f} s of compilation"
