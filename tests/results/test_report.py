"""Text on a run, against figures made up."""

import re

from model_problems import step_record

from fx_contact.parallel.timing import STAGES
from fx_contact.results.report import table_head, table_row, total_seconds


def columns(line):
    """What stands in the columns of a line: list of re.Match."""
    return list(re.finditer(r"\S+(?: \S+)*", line))


def test_a_row_of_the_table():
    """Each figure stands below its heading, in the unit of that."""
    figures = {"max_level": 3, "geometry_order": 4, "active_pairs": 1234, "contact_iterations": 5}
    figures |= {"cells": 98765, "dofs": 1234567, "krylov_iterations": [7, 8, 9], "estimate": 0.0825}
    record = step_record(2, assumed_effectivity=0.75, force=0.0125, seconds={"total": 61.5, "solve": 1.0}, **figures)
    head, row = table_head(), table_row(record)
    found = [(heading.group(), number.group()) for heading, number in zip(columns(head), columns(row))]
    assert [heading.end() for heading in columns(head)] == [number.end() for number in columns(row)]
    assert found == [
        ("step", "2"),
        ("cells", "98,765"),
        ("dofs", "1,234,567"),
        ("level", "3"),
        ("order", "4"),
        ("active", "1,234"),
        ("contact", "5"),
        ("krylov", "24"),
        ("error %", "8.25"),
        ("eff.", "0.75"),
        ("force", "1.25000e-02"),
        ("seconds", "61.50"),
    ]


def test_seconds_of_a_run():
    """All steps together, the longest stages first, compilation by itself."""
    one = dict.fromkeys(STAGES, 0.0) | {"compile": 20.0, "solve": 3.0, "mesh": 1.0, "total": 24.5}
    other = dict.fromkeys(STAGES, 0.0) | {"mesh": 4.0, "solve": 0.5, "total": 5.0}
    line = total_seconds([one, other])
    assert line.startswith("9.5 s (mesh 5.0, solve 3.5, ") and line.endswith(" and 20.0 s of compilation")
