"""A test that does not end is named on every rank, and ends."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import WORLD, outside

pytestmark = pytest.mark.skipif(WORLD.size > 1, reason="starts its own ranks")

#: One rank waits for a message that nobody sends, with and without the interpreter's lock, or fails where others wait.
PROGRAM = """
import ctypes
import pytest
from mpi4py import MPI

WORLD = MPI.COMM_WORLD

@pytest.mark.parametrize("number", [7])
def test_waits(number):
    if WORLD.rank == WORLD.size - 1:
        WORLD.recv(tag=number)

def test_keeps_the_lock():
    if WORLD.rank == WORLD.size - 1:
        ctypes.PyDLL(None).sleep(60)

def test_fails():
    assert WORLD.rank == WORLD.size - 1
    WORLD.Barrier()
"""


@pytest.mark.parametrize(
    "ranks, name, said",
    [
        (1, "waits", r"test_waits\[7\] does not end within 2 s: rank 0 of 1 is in\n(.*\n)+.*in test_waits\n"),
        (2, "waits", r"test_waits\[7\] does not end within 2 s: rank 1 of 2 is in\n(.*\n)+.*in test_waits\n"),
        (2, "keeps_the_lock", r"Timeout \(0:00:03\)!\n(.*\n)+.*in test_keeps_the_lock\n"),
        (2, "fails", r"\n +assert WORLD.rank == WORLD.size - 1\n(.*\n)*AssertionError"),
    ],
    ids=["alone", "waits", "keeps the lock", "fails"],
)
def test_hang(ranks, name, said, tmp_path):
    """It says where the rank is that others wait for, within the limit and some seconds."""
    (tmp_path / "test_it.py").write_text(PROGRAM)
    command = ["mpirun", "-n", str(ranks), sys.executable, "-m", "pytest", "-q", "-p", "conftest", "--limit", "2"]
    environment = outside() | {"PYTHONPATH": f"{Path(__file__).parents[1]}:{os.environ.get('PYTHONPATH', '')}"}
    command += ["-p", "no:cacheprovider", f"test_it.py::test_{name}"]
    result = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=60)
    assert result.returncode
    assert re.search(said, result.stdout + result.stderr), result.stdout + result.stderr
