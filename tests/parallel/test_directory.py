"""What ranks know of keys is brought together; errors of one rank are those of all."""

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import gathered, scramble

from fx_contact.parallel import exchange
from fx_contact.parallel.mpi import Directory, together

pytestmark = pytest.mark.ranks(1, 2, 3)


def in_blocks(keys):
    """Homes that are near each other where keys are."""
    return (keys * WORLD.size // 3000).astype(np.int32)


@pytest.fixture(params=[(exchange.FEW_RANKS, None), (0, None), (0, in_blocks)], ids=["", "partners", "blocks"])
def known(request, monkeypatch):
    """The keys of this rank, a random half of all, and what all ranks have, by both ways to exchange rows."""
    ranks, home = request.param
    monkeypatch.setattr(exchange, "FEW_RANKS", ranks)
    everyone = np.arange(0, 3000, 3)
    keys = everyone[scramble(everyone, WORLD.rank + 1) % np.uint64(2) == 0]
    return Directory(WORLD, keys, home), keys, gathered(WORLD, keys)


def test_lowest_value(known):
    """The lowest that any rank says of a key."""
    directory, keys, all_keys = known
    mine = (scramble(keys, 7 + WORLD.rank) % np.uint64(1000)).astype(np.int64)
    said, found = gathered(WORLD, mine), directory.lowest(mine)
    expected = np.full(3000, 10**9)
    np.minimum.at(expected, all_keys, said)
    everywhere((found == expected[keys]).all(), "not the lowest")


def test_owners_and_numbers(known):
    """Each key has one number, and one owner among the ranks with the highest claim; owners number without gaps."""
    directory, keys, _ = known
    claim = (scramble(keys, 11 + WORLD.rank) % np.uint64(3)).astype(np.int8)
    number, owner = directory.number(claim=claim)
    rank = np.full(len(keys), WORLD.rank)
    rows = gathered(WORLD, np.column_stack([keys, number, owner, rank, claim]))
    distinct = np.unique(rows[:, :3], axis=0)
    assert len(distinct) == len(np.unique(rows[:, 0])), "ranks disagree on a key"
    assert np.array_equal(np.sort(distinct[:, 1]), np.arange(len(distinct)))
    assert (np.diff(distinct[np.argsort(distinct[:, 1]), 2]) >= 0).all(), "not numbered owner by owner"
    for key, _, own in distinct:
        here = rows[rows[:, 0] == key]
        best = here[here[:, 4] == here[:, 4].max(), 3]
        assert own in best
    if WORLD.size > 1:
        shares = np.bincount(distinct[:, 2], minlength=WORLD.size)
        assert shares.min() > 0.5 * shares.mean(), "shared keys do not spread"


def test_owners_do_not_depend_on_homes():
    """Homes bring together what is known of a key, whichever rank they are: same owners, same numbers."""
    everyone = np.arange(0, 3000, 3)
    keys = everyone[scramble(everyone, WORLD.rank + 1) % np.uint64(2) == 0]
    one, other = (Directory(WORLD, keys, home).number() for home in (None, in_blocks))
    everywhere(all(np.array_equal(a, b) for a, b in zip(one, other)), "homes decide on owners")


def test_lookup_and_asked(known):
    """What any rank has said of a key comes to whoever asks; who asks for keys that nobody has hears nothing."""
    directory, keys, all_keys = known
    queries = (scramble(np.arange(500), 5 + WORLD.rank) % np.uint64(3000)).astype(np.int64)
    rows, found = directory.lookup(queries, np.column_stack([keys, keys**2]), np.ones(len(keys), dtype=bool))
    everywhere((found == np.isin(queries, all_keys)).all(), "another key is known")
    everywhere((rows[found] == np.column_stack([queries, queries**2])[found]).all(), "another answer")
    everywhere((directory.asked(queries) == np.isin(keys, gathered(WORLD, queries))).all(), "others are asked for")


@pytest.mark.parametrize("where", range(WORLD.size))
def test_an_error_of_one_rank_is_one_of_all(where):
    """It is raised on every rank, with what it says."""
    with pytest.raises(KeyError, match=f"on {where}"):
        with together(WORLD):
            if WORLD.rank == where:
                raise KeyError(f"on {where}")


def test_the_lowest_rank_speaks_for_those_without_an_error():
    """Others that have failed raise their own."""
    failed = WORLD.rank > 0 or WORLD.size == 1
    with pytest.raises(KeyError, match=str(WORLD.rank or min(1, WORLD.size - 1))):
        with together(WORLD):
            if failed:
                raise KeyError(WORLD.rank)


class Stubborn(Exception):
    """One that pickle writes and cannot read."""

    def __init__(self, what, why):
        super().__init__(f"{what} {why}")


def test_errors_that_cannot_be_sent():
    """Others raise one that says the same; the rank itself its own."""
    with pytest.raises(Stubborn if WORLD.rank == WORLD.size - 1 else RuntimeError, match="^(Stubborn: )?it fails$"):
        with together(WORLD):
            if WORLD.rank == WORLD.size - 1:
                raise Stubborn("it", "fails")
