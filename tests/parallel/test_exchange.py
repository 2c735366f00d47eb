"""Rows reach their destinations and answers come back, all to all and from point to point."""

import time

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import gathered, scramble
from mpi4py import MPI

from fx_contact.parallel import exchange
from fx_contact.parallel.exchange import Exchange

pytestmark = pytest.mark.ranks(1, 2, 3)


@pytest.fixture(params=[exchange.FEW_RANKS, 0], ids=["all to all", "partners"], autouse=True)
def way(request, monkeypatch):
    """Both ways to exchange rows."""
    monkeypatch.setattr(exchange, "FEW_RANKS", request.param)
    return request.param


def strewn(count, salt):
    return (scramble(np.arange(count), salt) % np.uint64(WORLD.size)).astype(int)


@pytest.mark.parametrize("count", [0, 1, 100])
def test_answers_come_back(count):
    """An exchange and its way back, in the order in which the rows were sent."""
    destination = strewn(count, WORLD.rank)
    there = Exchange(WORLD, destination)
    arrived = there.forward(np.column_stack([np.full(count, WORLD.rank), destination, np.arange(count)]))
    everywhere((arrived[:, 1] == WORLD.rank).all() and (arrived[:, 0] == there.source).all(), "went elsewhere")
    rows = gathered(WORLD, destination)
    assert WORLD.allreduce(len(arrived)) == len(rows)
    order = np.diff(arrived[:, 0] * (count + 1) + arrived[:, 2])
    everywhere((order > 0).all(), "neither by rank nor as sent")
    back = there.backward(arrived)
    everywhere((back[:, 2] == np.arange(count)).all() and (back[:, 1] == destination).all(), "another order")


@pytest.mark.parametrize("shape, dtype", [((), bool), ((3,), np.int8), ((2, 3), float), ((0,), np.int64)])
def test_rows_of_any_kind(shape, dtype):
    """They come as they are."""
    there = Exchange(WORLD, strewn(40, 3 + WORLD.rank))
    rows = np.arange(40 * int(np.prod(shape))).reshape(40, *shape).astype(dtype)
    back = there.backward(there.forward(rows))
    everywhere(back.dtype == dtype and np.array_equal(back, rows), "other rows")


def test_partners():
    """They are the ranks that rows go to or come from: here the next one and the one before."""
    size, rank = WORLD.size, WORLD.rank
    there = Exchange(WORLD, np.full(5, (rank + 1) % size))
    found = {(rank + 1) % size, (rank - 1) % size} - {rank}
    everywhere(set(there.partners.tolist()) == found, "others")
    everywhere((there.forward(np.full(5, rank)) == (rank - 1) % size).all(), "rows of another rank")
    assert len(Exchange(WORLD, np.empty(0, dtype=np.int64)).partners) == 0


def test_no_deadlock_where_ranks_are_late():
    """Ranks come late at random, one after another: each exchange has its own rows."""
    late = np.random.default_rng(WORLD.rank)
    for turn in range(60):
        destination = strewn(turn % 7, 100 * turn + WORLD.rank)
        time.sleep(late.choice([0.0, 0.0, 1e-4, 3e-3]))
        there = Exchange(WORLD, destination)
        if late.random() < 0.3:
            time.sleep(2e-3)
        back = there.backward(there.forward(np.full(len(destination), turn)) + there.source)
        everywhere((back == turn + WORLD.rank).all(), f"rows of another exchange than {turn}")


def test_one_rank_may_be_ahead():
    """Numbers of rows are those of this exchange where others are in the next already, one after the other."""
    others = np.setdiff1d(np.arange(WORLD.size), WORLD.rank)
    made = [Exchange(WORLD, np.repeat(others, turn)) for turn in range(1, 101)]
    found = all(np.array_equal(there.source, np.repeat(others, turn)) for turn, there in enumerate(made, 1))
    everywhere(found, "rows of another exchange")


def test_a_receive_of_the_user_gets_none_of_it():
    """One that takes any message of any rank waits for the user's own."""
    mine, given = np.zeros(1, dtype=np.int64), np.full(1, 77)
    waiting = WORLD.Irecv(mine, MPI.ANY_SOURCE, MPI.ANY_TAG)
    there = Exchange(WORLD, np.arange(WORLD.size))
    rows = there.backward(there.forward(np.arange(WORLD.size)))
    early = waiting.Test()
    WORLD.Barrier()
    WORLD.Send(given, (WORLD.rank + 1) % WORLD.size)
    waiting.Wait()
    everywhere(not early and mine[0] == 77 and np.array_equal(rows, np.arange(WORLD.size)), "taken by the user")


def test_on_a_communicator_of_some_ranks():
    """Ranks are those of the communicator; one that the user frees leaves nothing behind that hangs."""
    part = WORLD.Split(WORLD.rank % 2)
    there = Exchange(part, np.full(3, part.size - 1))
    rows = there.forward(np.full(3, part.rank))
    expected = np.repeat(np.arange(part.size), 3) if part.rank == part.size - 1 else []
    part.Free()
    everywhere(np.array_equal(rows, expected), "other ranks")
