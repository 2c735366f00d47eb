"""The rules by which single pairs change: noise, ties, and what ends a cycle."""

from types import SimpleNamespace

import numpy as np
import pytest
from conftest import WORLD, everywhere
from mpi4py import MPI

from fx_contact.contact.active_set import ActiveSet


def active_set(penetration, largest=0.0, comm=MPI.COMM_SELF):
    """An ActiveSet of pairs with these penetrations at first, numbered rank by rank; the largest displacement."""
    size = len(penetration)
    rows = SimpleNamespace(
        prolongation=SimpleNamespace(comm=comm),
        penetration=lambda u: np.array(penetration),
        capped_stiffness=np.ones(size),
        key=comm.rank * size + np.arange(size),
    )
    return ActiveSet(rows, None, np.full((size, 3), largest), 100)


def test_first_guess():
    """Pairs that overlap are closed; if none does by more than rounding those that are closest to touching are."""
    assert active_set([1e-3, -1e-3, -1.0], largest=1.0).active.tolist() == [True, False, False]
    assert active_set([1e-13, -1e-13, -1e-3], largest=1.0).active.tolist() == [True, True, False]
    assert active_set([-1.0, -2.0, -1.0]).active.tolist() == [True, False, True]


def test_a_pair_keeps_its_status_within_the_noise():
    """A closed one that pulls by less than the solver's error stays, and so does an open one that overlaps by less."""
    status = active_set([1.0, 1.0, -1.0, -1.0])
    assert status.active.tolist() == [True, True, False, False]
    assert status.wanted(np.array([1.0, -0.5e-3, 0.5e-3, -1.0]), 1e-3).tolist() == [True, True, False, False]
    assert status.wanted(np.array([1.0, -2e-3, 2e-3, -1.0]), 1e-3).tolist() == [True, False, True, False]


def test_nothing_presses_within_the_noise():
    """Where no pair is pressed harder than the solver's error all are open."""
    status = active_set([1.0, -1.0])
    assert not status.wanted(np.array([0.5e-3, 0.9e-3]), 1e-3).any()
    assert status.wanted(np.array([2e-3, 0.9e-3]), 1e-3).tolist() == [True, False]


@pytest.mark.parametrize("comm", [MPI.COMM_SELF, WORLD], ids=["one rank", "all ranks"])
def test_single_changes(comm):
    """Where a set would come back the lowest pair changes alone, until fewer are wrong than ever before."""
    status = active_set([0.0, -1.0, -2.0], comm=comm)
    at_first = status.active.copy()
    assert at_first.tolist() == [True, False, False]
    first = comm.rank == 0

    def now(*expected):
        """Rank 0 has these closed, the others none of them."""
        everywhere(status.active.tolist() == list(expected) if first else True, f"{status.active} on rank 0")

    status.update(~at_first)
    now(False, True, True)
    status.update(at_first)  # seen: one by one
    now(True, True, True)
    everywhere(first or status.active.tolist() == [False, True, True], "a pair of another rank changes too")
    status.update(~status.active)  # as many are wrong as at the start
    now(False, True, True)
    fewer = status.active.copy()
    fewer[1:] = False if first else fewer[1:]
    status.update(fewer)  # only two are: all at once
    now(False, False, False)
