"""The rules by which single pairs change: noise, ties, and what ends a cycle."""

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import WORLD, everywhere
from mpi4py import MPI

from fx_contact.contact.constraint_rows import Role
from fx_contact.law.unilateral import Unilateral
from fx_contact.parallel.errors import SolveError

pytestmark = pytest.mark.ranks(1, 2, 3)


def active_set(penetration, largest=0.0, comm=MPI.COMM_SELF, most=100, tied=None):
    """The status of pairs with these penetrations at first, numbered rank by rank; the largest displacement."""
    size = len(penetration)
    rows = SimpleNamespace(
        prolongation=SimpleNamespace(comm=comm),
        penetration=lambda u: np.array(penetration, dtype=float),
        capped_stiffness=np.ones(size),
        key=comm.rank * size + np.arange(size),
        role=np.full(size, Role.NORMAL) if tied is None else np.where(tied, Role.EQUATION, Role.NORMAL),
        kinds=(),
        symmetry=1,
    )
    u = np.full((size, 3), largest)
    return Unilateral(rows, None, u, most)


def test_first_guess():
    """Pairs that overlap are closed; if none does by more than rounding those that are closest to touching are."""
    assert active_set([1e-3, -1e-3, -1.0], largest=1.0).active.tolist() == [True, False, False]
    assert active_set([1e-13, -1e-13, -1e-3], largest=1.0).active.tolist() == [True, True, False]
    assert active_set([-1.0, -2.0, -1.0]).active.tolist() == [True, False, True]


def test_rows_of_ties_are_always_closed():
    """They are in every set, whatever their force, and decide of no other row."""
    tied = [True, False, False, True]
    status = active_set([-5.0, -2.0, -1.0, 7.0], tied=tied)
    assert status.active.tolist() == [True, False, True, True]
    assert status.wanted(np.array([-9.0, -1.0, 1e-3, 9.0]), 1e-6).tolist() == [True, False, True, True]
    assert status.wanted(np.array([-9.0, -1.0, -2.0, 9.0]), 1e-6).tolist() == tied
    assert active_set([-1.0, 3.0], tied=[True, True]).wanted(np.array([-1.0, 2.0]), 0.0).all()


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


def flexible(number, size):
    """A random complementarity problem: f >= 0, g - M f <= 0, f (g - M f) = 0, with positive definite M."""
    random = np.random.default_rng(number)
    factor = random.normal(size=(size, 3))
    return factor @ factor.T + 0.01 * np.eye(size), random.normal(size=size)


def trial_force(matrix, gap, active):
    """Forces of the closed pairs, penetrations of the open ones."""
    force = np.zeros(len(gap))
    force[active] = np.linalg.solve(matrix[np.ix_(active, active)], gap[active])
    return np.where(active, force, gap - matrix @ force)


def test_active_set_ends():
    """Where changing all wrong pairs at once cycles, the rules still end, and with the solution."""
    size, cycles = 8, 0
    for number in range(200):
        matrix, gap = flexible(number, size)
        if not (gap > 0).any():
            continue
        (solution,) = (
            on
            for on in map(np.array, product([False, True], repeat=size))
            if (np.where(on, 1, -1) * trial_force(matrix, gap, on) > 0).all()
        )
        plain, seen = np.arange(size) == 0, set()
        while plain.tobytes() not in seen:
            seen.add(plain.tobytes())
            plain = trial_force(matrix, gap, plain) > 0
        cycles += (plain != solution).any()

        status = active_set(-np.arange(size), most=200)
        while status.differs(wanted := status.wanted(trial_force(matrix, gap, status.active), 0.0)):
            status.update(wanted)
        assert (status.active == solution).all()
    assert cycles > 3, "no problem cycles without the rules"


def test_light_contact_within_the_solvers_error_ends():
    """Pairs that overlap when they are open stay closed, though their forces are less than the solver's error."""
    status, noise = active_set([0, -1, -2], most=10), 1e-3
    light = np.array([1e-4, 1e-4, 0.0])
    for _ in range(10):
        overlap = np.array([1e-2, 1e-2, -1e-2])  # by which open pairs know that they must close
        wanted = status.wanted(np.where(status.active, light, overlap), noise)
        if not status.differs(wanted):
            break
        status.update(wanted)
    assert status.active.tolist() == [True, True, False]


def test_what_pulls_is_not_tried_in_turn():
    """Where a body needs now this pair, now that one to hold it, and both pull, that is the error."""

    class Above:
        """A body above both pairs."""

        driven = staticmethod(lambda active: {} if active.any() else {"upper": "along z"})
        rates = staticmethod(lambda active: (np.ones(2), np.inf))
        gaps = staticmethod(lambda active: np.array([0.0, 1.0]))

    status = active_set([0, -1], most=20)
    status._support, status._resisting = Above(), lambda active: active
    with pytest.raises(SolveError, match="nothing holds body 'upper'"):
        for _ in range(20):
            closest = np.where(status.active, -2.0, -1.0)
            status.update(status.wanted(closest, 0.0))
    assert status.updates < 5


def test_limit_of_updates():
    """The user's limit ends the run; by default there is none."""
    status = active_set(-np.arange(5), most=3)
    with pytest.raises(SolveError, match="after 3 linear solves, the limit that Solver.max_contact sets"):
        for _ in range(4):
            status.update(~status.active)


@pytest.mark.parametrize("comm", [MPI.COMM_SELF, WORLD], ids=["one rank", "all ranks"])
def test_single_changes_that_recur_end(comm):
    """Exact solutions exclude a set that recurs by single changes: the linear solver's error decides."""
    status = active_set([0.0, -1.0, -2.0], comm=comm, most=None)
    with pytest.raises(SolveError, match="repeats itself after .* smaller Solver.tolerance"):
        for _ in range(20):
            status.update(~status.active)
    assert status.updates < 10


def test_restart():
    """Another set is tried afresh: all rows of wrong status change at once."""
    status = active_set([0.0, -1.0, -2.0])
    for _ in range(3):
        status.update(~status.active)
    status.restart(np.array([True, True, False]), np.zeros((3, 3)), 20)
    assert status.active.tolist() == [True, True, False]
    assert status.updates == 25
    status.update(np.array([False, False, True]))
    assert status.active.tolist() == [False, False, True]
