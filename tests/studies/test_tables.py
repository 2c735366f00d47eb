"""The tables of the pages are those of the CSV files, which say where they come from."""

import re

import pytest
from conftest import WORLD

from studies.tables import CHOSEN, PAGES, TABLE, TOP, markdown, read, with_tables, write

pytestmark = pytest.mark.skipif(WORLD.size > 1, reason="reads files")
TEXTS = [(TOP / page).read_text() for page in PAGES]
NAMES = [found[2] for text in TEXTS for found in re.finditer(TABLE, text)]


def test_pages_agree_with_the_files():
    """`python3 -m studies.tables` would change nothing; all tables are found, every choice of rows is on a page."""
    assert [with_tables(text) for text in TEXTS] == TEXTS
    assert len(NAMES) == "".join(TEXTS).count("<!-- table: ") == "".join(TEXTS).count("<!-- end of table -->") > 30
    assert set(CHOSEN) <= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_files_name_their_origin(name):
    """One revision, machine and command, and rows."""
    path = TOP / name.partition("#")[0]
    about, rows = read(path)
    assert {"revision", "machine", "command"} <= set(about) and rows
    assert path.read_text().count("# revision: ") == 1


def test_a_number_typed_into_a_page_is_noticed():
    """Another number between the marks is replaced."""
    text = (TOP / "docs" / "verification.md").read_text()
    assert with_tables(text.replace("| 7,590 |", "| 7,591 |")) == text and "| 7,590 |" in text


def test_write_and_read(tmp_path):
    """Numbers come back; what is missing leaves a cell empty, or the next form is taken."""
    write(tmp_path / "a" / "x.csv", [{"n": 1000, "error": 0.0123456789}, {"n": 2, "estimate": 0.5}], "python3 x.py")
    about, rows = read(tmp_path / "a" / "x.csv")
    assert about["command"] == "./with-dolfinx python3 x.py" and "cores" in about["machine"]
    assert rows[0]["error"] == 0.0123457 and rows[1]["error"] == ""
    columns = {"n": "{n:,}", "error": "{error:.1%} or ({estimate:.1%})", "estimate": "{estimate}"}
    assert markdown(rows, columns).splitlines()[2:] == ["| 1,000 | 1.2% |  |", "| 2 | (50.0%) | 0.5 |"]


def test_a_part_of_a_study_says_so(tmp_path, monkeypatch):
    """The command of a table is the one that was given, with its options."""
    monkeypatch.setattr("sys.orig_argv", ["/usr/bin/python3", "-m", "studies.cost.thin", "--scene", "a plate"])
    write(tmp_path / "x.csv", [{"n": 1}])
    assert read(tmp_path / "x.csv")[0]["command"] == "./with-dolfinx python3 -m studies.cost.thin --scene 'a plate'"
