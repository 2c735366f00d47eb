"""The table of mutations fits the code as it is, and the tests that it names are there."""

from collections import Counter
from dataclasses import replace

import pytest
import run
from conftest import WORLD

pytestmark = pytest.mark.skipif(WORLD.size > 1, reason="the same on every rank")


def test_table_fits_the_code():
    """Each piece is there, once; nothing is there twice; at least 60 mutations change results."""
    table = run.mutations()
    assert not [f"{mutation}: {fault}" for mutation in table for fault in run.faults(mutation)]
    assert [mutation.line for mutation in table] == run.TABLE.read_text().splitlines()[1:]
    assert max(Counter((m.file, m.old, m.new) for m in table).values()) == 1
    assert sum(m.ranks > 0 for m in table) >= 60


def test_the_check_can_fail():
    """A piece that is lost, one that is no Python any more, and a test that is not there are seen."""
    right = next(m for m in run.mutations() if m.ranks)
    assert not run.faults(right)
    for wrong in ({"old": "no such piece"}, {"new": "("}, {"tests": ("forest/test_forest.py::test_nothing",)}):
        assert run.faults(replace(right, **wrong))
