"""Guards of memory, right below and above what a host has."""

import numpy as np
import pytest
from conftest import WORLD
from model_problems import pressed, roots, two_boxes
from mpi4py import MPI

from fx_contact.adaptive import beginning
from fx_contact.forest import forest as forests
from fx_contact.parallel import memory
from fx_contact.parallel.errors import SolveError

pytestmark = pytest.mark.ranks(1, 2, 3)


@pytest.fixture
def on_one_host(monkeypatch):
    """A host of all ranks that has 60,000,000 bytes; one rank is told more."""
    monkeypatch.setattr(memory, "available", lambda: 60_000_000 + (WORLD.size > 1) * (WORLD.rank == 0))


def test_what_ranks_take_together(on_one_host):
    """What all need is compared with the least that any is told, and said in the largest unit."""
    each = 60_000_000 // WORLD.size
    assert memory.shortage(WORLD, each) is None
    more = each + (WORLD.rank == WORLD.size - 1) * 60_000
    assert memory.shortage(WORLD, more) == (WORLD.size * each + 60_000, 60_000_000)
    with pytest.raises(SolveError, match=r"^it needs 60.1 MB on a host that has 60.0 MB left; take less$"):
        memory.check_memory(WORLD, "it", more, "take less")
    assert [memory._size(count) for count in (1e9, 1e6, 999e3, 0)] == ["1.0 GB", "1.0 MB", "999.0 kB", "0.0 kB"]


def test_leaves_are_those_to_come(monkeypatch, on_one_host):
    """Before leaves are made the guard counts their children, of all ranks in words, of this one in bytes."""
    asked = []
    monkeypatch.setattr(memory, "check_memory", lambda comm, what, needed, advice: asked.append((what, needed)))
    start = roots(pressed(two_boxes()))
    marked = np.zeros(len(start), dtype=bool)
    marked[: 1 + WORLD.rank] = True
    finer, _ = start.refined(marked)
    assert asked == [(f"a forest of {WORLD.allreduce(len(finer)):,} leaves", memory._LEAF_BYTES * len(finer))]
    assert len(finer) > len(start) or not len(start)
    asked.clear()
    forest = beginning.Beginning.uniform(pressed(two_boxes()), 2).forest
    assert asked[0] == (f"a forest of {64 * 12:,} leaves", memory._LEAF_BYTES * len(forest))
    assert forests.check_leaves is beginning.check_leaves is memory.check_leaves


def test_nothing_is_known(monkeypatch):
    """A host that does not tell has enough."""
    monkeypatch.setattr(memory, "available", lambda: np.inf)
    assert memory.shortage(MPI.COMM_SELF, 1 << 60) is None
