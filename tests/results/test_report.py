"""Text on a run, against figures made up."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import step_record

from fx_contact import Step, StepRecord, adapt, solve, sweep
from fx_contact.adaptive.contact_table import ContactTable
from fx_contact.adaptive.step_report import table_head, table_row
from fx_contact.estimate.goal_errors import GoalRecord
from fx_contact.items.units import labelled, unit_of
from fx_contact.parallel.timing import STAGES
from fx_contact.results.report import force_warnings, total_seconds
from fx_contact.scenes import hertz, stack
from fx_contact.verdict.resultants import Resultant


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


def resultant(kind, name, *force):
    """A resultant without moment."""
    return Resultant(name, kind, force, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1)


@pytest.mark.parametrize("reached, radius", [(True, 0.25), (False, None)])
def test_report_of_a_step(reached, radius):
    """Lines with the figures of the record: each contact with its own force, resultants without rounding, goals."""
    figures = {"scene": "it", "ranks": 2, "cells": 1234, "geometry_order": 3, "max_level": 4, "dofs": 5678}
    figures |= {"hanging_nodes": 99, "estimate": 0.025, "tolerance": 0.5, "reached": reached, "active_pairs": 12}
    figures |= {"degree": 2, "pair_forces": [2.5, 0.0, 2.0], "max_pressure": 7.25, "contact_radius": radius}
    figures |= {
        "pair_errors": [0.03, None, None],
        "motions": {"c on rigid sphere": 0.125},
        "pair_alignments": [1, None, 1],
        "pair_areas": [0.5, 0.0, 0.25],
    }
    pairs = (resultant("contact", name, 0.0, 0.0, 1.0) for name in ("a on b", "b on c", "c on rigid sphere"))
    others = resultant("pressure", "top", 1e-9, -2.5, 0.001), resultant("symmetry", "side", 1e-9, 0.0, 0.0)
    others += (resultant("balance", "a", 1e-9, 0.0, 0.0),)
    goal = GoalRecord("gap of 'a'", 0.5, 0.05, 0.1, 0.1, True)
    record = step_record(3, force=4.5, resultants=(*pairs, *others), goals=(goal,), **figures)
    text = Step.__repr__(SimpleNamespace(record=record))
    assert text == (
        "step 3 of 'it' on 2 ranks\n  1,234 cells of order 3, up to level 4\n"
        "  5,678 unknowns of degree 2, 99 hanging nodes\n"
        f"  estimated error 2.5%, tolerance 50%{'' if reached else ' not'} reached\n"
        f"  12 contact nodes closed, largest pressure 7.25{', contact radius 0.25' * reached}\n"
        "  contact 'a on b': force 2.5, estimated error 3%\n    area 0.5, mean pressure 5\n  contact 'b on c': open\n"
        "  contact 'c on rigid sphere': force 2, obstacle moved by 0.125\n    area 0.25, mean pressure 8\n"
        "  pressure 'top': force (0, -2.5, 0.001)\n"
        "  gap of 'a': 0.5, estimated error 5%, tolerance 10% reached"
    )
    costs = {"seconds": {"total": 1.25}, "cpu_seconds": {"total": 2.4}, "peak_memory_bytes": 3_210_000_000}
    assert str(replace(record, **costs)) == text + "\n  1.2 s of wall time, 2.4 s of CPU time, 3,210 MB of memory"
    assert "closed" not in str(replace(record, pair_forces=[], **costs)), "a scene without contact"


def test_units_of_a_report():
    """They stand behind forces, pressure and lengths, and are in the record; without names nothing changes."""
    figures = {
        "scene": "it",
        "pair_forces": [2.5],
        "max_pressure": 7.25,
        "contact_radius": 0.25,
        "pair_errors": [None],
        "pair_areas": [0.5],
    }
    figures |= {"motions": {"top on rigid plane": 0.125}, "force": 2.5}
    forces = ("contact", "top on rigid plane"), ("reaction", "top")
    figures |= {"resultants": tuple(resultant(kind, name, 0.0, 0.0, 2.5) for kind, name in forces)}
    plain = step_record(0, **figures)
    named = replace(plain, units=("mm", "GPa"))
    text = Step.__repr__(SimpleNamespace(record=named))
    for words in (
        "7.25 GPa, contact radius 0.25 mm",
        "force 2.5 kN, obstacle moved by 0.125 mm",
        "area 0.5 mm², mean pressure 5 GPa",
        "(0, 0, 2.5) kN",
    ):
        assert words in text
    for unit in (" GPa", " mm²", " mm", " kN"):
        text = text.replace(unit, "")
    assert text == Step.__repr__(SimpleNamespace(record=plain))
    assert "units" not in plain.as_json() and StepRecord.from_json(json.loads(json.dumps(named.as_json()))) == named


@pytest.mark.parametrize(
    "units, force", [(("m", "Pa"), "N"), (("mm", "MPa"), "N"), (("in", "ksi"), "ksi in²"), (None, "")]
)
def test_unit_of_force(units, force):
    """Stress times area, by its own name where it has one; no text gets brackets without a unit."""
    assert unit_of("force", units) == force and unit_of("number", units) == ""
    assert labelled("force", "force", units) == (f"force [{force}]" if force else "force")


@pytest.mark.ranks(1, 2)
def test_forces_of_a_chain():
    """Three blocks under one load: each contact and each end carries it, none their sum."""
    step = solve(stack(cells=(1, 1, 1)), 0.9, max_steps=1, degree=1)
    text, force = repr(step), f"{step.record.pair_forces[0]:.6g}"
    assert text.count(f": force {force}") == 2 and f"'top': force (0, 0, -{force})" in text
    assert f"{step.record.force:.6g}" not in text


@pytest.mark.ranks(1, 2)
def test_rows_while_it_runs(capfd):
    """The table of a run, a row as soon as its step is done, on rank 0 alone; its state above the whole table."""
    run = adapt(hertz(order=2, coarse=2), 0.3, WORLD, progress=True)
    assert "no step yet" in repr(run) and len(repr(run).splitlines()) == 2
    run.last_step()
    rows = [table_head(), *map(table_row, run.records)]
    everywhere(capfd.readouterr().err == ("" if WORLD.rank else "\n".join([*rows, ""])), "other rows")
    caption, *table = repr(run).splitlines()
    assert caption == "run of 'hertz', tolerance 30%: reached" and table == rows and len(rows) > 2


@pytest.mark.ranks(1, 2)
def test_table_of_a_load_path():
    """A row for each point, the parameter's value before the columns of its last step."""
    path = sweep(lambda moved: stack(cells=(1, 1, 1), displacement=moved), [1e-3, 2e-3], 0.9, degree=1, max_steps=1)
    assert "0 of 2 points" in repr(path) and len(repr(path).splitlines()) == 2
    last = [point.record.record for point in path][-1]
    caption, _, *rows = repr(path).splitlines()
    assert "2 of 2 points" in caption and len(rows) == 2
    assert rows[-1].split() == ["0.002", *table_row(last).split()]


def test_state_of_contact():
    """Rows and closed ones are counted, forces added up with their signs, the largest pressure is one of them."""
    vectors, force = np.zeros((3, 3)), np.array([2.0, -0.5, 1.0])
    active = np.array([True, False, True])
    table = ContactTable(vectors, vectors, np.array([3.0, 4.5, 1.0]), force, force, active, np.zeros(3, int), ("it",))
    assert repr(table) == "contact: 3 contact nodes, 2 closed\n  force 2.5, largest pressure 4.5"


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
