"""Text on a run, against figures made up."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from model_problems import step_record

from fx_contact import results
from fx_contact.adaptive.contact_state import ContactTable
from fx_contact.adaptive.step import Step
from fx_contact.parallel.timing import STAGES
from fx_contact.results.report import force_warnings, table_head, table_row, total_seconds


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
    expected = "step 2, cells 98,765, dofs 1,234,567, level 3, order 4, active 1,234, contact 5, krylov 24, "
    expected += "error % 8.25, eff. 0.75, force 1.25000e-02, seconds 61.50"
    assert ", ".join(f"{heading} {number}" for heading, number in found) == expected


def test_seconds_of_a_run():
    """All steps together, the longest stages first, compilation by itself."""
    one = dict.fromkeys(STAGES, 0.0) | {"compile": 20.0, "solve": 3.0, "mesh": 1.0, "total": 24.5}
    other = dict.fromkeys(STAGES, 0.0) | {"mesh": 4.0, "solve": 0.5, "total": 5.0}
    line = total_seconds([one, other])
    assert line.startswith("9.5 s (mesh 5.0, solve 3.5, ") and line.endswith(" and 20.0 s of compilation")


@pytest.mark.parametrize("reached, radius", [(True, 0.25), (False, None)])
def test_state_of_a_step(reached, radius):
    """Lines with the figures of the record, forces and pressures with their signs."""
    figures = {"scene": "it", "ranks": 2, "cells": 1234, "geometry_order": 3, "max_level": 4, "dofs": 5678}
    figures |= {"hanging_nodes": 99, "estimate": 0.025, "tolerance": 0.5, "reached": reached, "active_pairs": 12}
    figures |= {"degree": 2, "pair_forces": [0.5], "max_pressure": 7.25, "contact_radius": radius}
    record = step_record(3, force=0.5, **figures)
    step = SimpleNamespace(record=record, rows=())
    text = Step.__repr__(step)
    assert text == (
        "step 3 of 'it' on 2 ranks\n  1,234 cells of order 3, up to level 4\n"
        "  5,678 unknowns of degree 2, 99 hanging nodes\n"
        f"  estimated error 2.5%, tolerance 50%{'' if reached else ' not'} reached\n"
        f"  12 node pairs closed: force 0.5, largest pressure 7.25{', contact radius 0.25' * reached}"
    )
    step.rows = None
    assert "closed" not in Step.__repr__(step)


def test_former_name_of_the_warnings():
    """It says the new one."""
    with pytest.warns(DeprecationWarning, match="doubt_lines is now model_warnings"):
        assert results.doubt_lines is results.model_warnings


def test_state_of_contact():
    """Rows and closed ones are counted, forces added up with their signs, the largest pressure is one of them."""
    vectors, force = np.zeros((3, 3)), np.array([2.0, -0.5, 1.0])
    active = np.array([True, False, True])
    table = ContactTable(vectors, vectors, np.array([3.0, 4.5, 1.0]), force, force, active, np.zeros(3, int), ("it",))
    assert repr(table) == "contact: 3 node pairs, 2 closed\n  force 2.5, largest pressure 4.5"


def test_warnings_of_forces():
    """Those whose error is above the tolerance, by name or number; a force that is 0, or has no error, has none."""
    figures = {"pair_errors": [0.1, 0.11, 5, None, 2], "pair_leaves": [0, 1234, 0, 0, 0]}
    record = step_record(0, tolerance=0.1, pair_forces=[1.0, 2.0, 0.0, 3.0, 4.0], **figures)
    first, second = force_warnings(record)
    assert first == (
        "contact pair 1: the estimated error of its force is 11%; 1,234 leaves are marked for it: allow more steps"
    )
    assert second.startswith(
        "contact pair 4: the estimated error of its force is 100%; no leaf is refined for errors"
    )
    of_pairs = tuple(SimpleNamespace(kind="contact", name=f"a on {name}") for name in "bcdef")
    named = replace(record, resultants=(*of_pairs, SimpleNamespace(kind="balance", name="a")))
    assert [line.split(":")[0] for line in force_warnings(named)] == [
        "contact pair 'a on c'",
        "contact pair 'a on f'",
    ]
