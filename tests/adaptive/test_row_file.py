"""What a file of rows holds comes back, and what is not as it was written is seen."""

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import gathered

from fx_contact.adaptive.row_file import RowFile, write_rows
from fx_contact.parallel.errors import CheckpointError


@pytest.fixture
def path(tmp_path):
    """A file with two tables, of which each rank has written other numbers of rows."""
    path = WORLD.bcast(tmp_path) / "rows"
    mine = np.arange(1000 * WORLD.rank, 1000 * WORLD.rank + 7 + WORLD.rank, dtype=np.int64)
    write_rows(
        path, WORLD, {"some": "content"}, {"numbers": mine[:, None], "squares": np.stack([mine, mine**2], 1) / 3}
    )
    return path


def test_rows_come_back(path):
    """In the order of the ranks, dealt out evenly."""
    file = RowFile(path, WORLD)
    numbers, squares = file.table("numbers"), file.table("squares")
    assert file.content == {"some": "content"}
    expected = np.concatenate([np.arange(1000 * rank, 1000 * rank + 7 + rank) for rank in range(WORLD.size)])
    assert np.array_equal(gathered(WORLD, numbers)[:, 0], expected)
    everywhere(np.array_equal(squares, np.column_stack([numbers, numbers**2]) / 3), "tables do not fit together")
    assert np.ptp(WORLD.allgather(len(numbers))) <= 1


def exchanged(data):
    """The last two words of the file change places."""
    return data[:-16] + data[-8:] + data[-16:-8]


@pytest.mark.parametrize(
    "spoil, message",
    [
        (exchanged, "its table"),
        (lambda data: data + b"12345678", "not complete"),
        (lambda data: data[:-8], "not complete"),
    ],
    ids=["words exchanged", "a word more", "a word less"],
)
def test_spoilt(path, spoil, message):
    """Words at other places, and a length that is not the one written."""
    if WORLD.rank == 0:
        path.write_bytes(spoil(path.read_bytes()))
    WORLD.Barrier()
    with pytest.raises(CheckpointError, match=message):
        RowFile(path, WORLD).table("squares")
