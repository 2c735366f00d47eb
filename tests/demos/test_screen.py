"""What the demos say while they run: a line a step, the stage at work on a terminal, nothing if that is asked for."""

import json
import os
import runpy
import subprocess
import sys
import termios
from pathlib import Path

import pytest
from conftest import WORLD, outside

DEMO = Path(__file__).parents[2] / "demos" / "hertz.py"

#: Demos with `common.Report`.
REPORTING = [path.stem for path in sorted(DEMO.parent.glob("*.py")) if "Report(given" in path.read_text()]

pytestmark = pytest.mark.skipif(WORLD.size > 1, reason="a demo is a process of its own")


def said(folder, *options, terminal=False):
    """Standard output and standard error of a demo of one step; the latter goes to a terminal if asked for."""
    words = [sys.executable, DEMO, "--max-steps", "1", "--order", "2", "--coarse", "2", "--records-only"]
    above, below = os.openpty() if terminal else os.pipe()
    if terminal:
        termios.tcsetwinsize(below, (24, 80))  # a terminal without width has no room for a line
    command = [*words, "--output", folder, *options]
    process = subprocess.Popen(command, env=outside(), stdout=subprocess.PIPE, stderr=below)
    os.close(below)
    heard = b""
    while True:
        try:
            block = os.read(above, 4096)
        except OSError:  # how a terminal ends
            break
        if not block:
            break
        heard += block
    os.close(above)
    out = process.communicate()[0].decode()
    assert process.returncode == 0, heard.decode()
    return out, heard.decode()


def test_stages_on_a_terminal(tmp_path):
    """They are shown one after the other in one line, and wiped out in the end."""
    out, err = said(tmp_path, terminal=True)
    assert "step 0: assemble" in err and "step 0: estimate" in err
    assert "\n" not in err.strip() and not err.split("\r")[-1].strip()
    assert "step 0:" not in out and "largest pressure" in out


def test_silence_elsewhere(tmp_path):
    """No stages in a file; with --quiet nothing at all, but the records are there."""
    out, err = said(tmp_path / "a")
    assert "largest pressure" in out and err == ""
    assert said(tmp_path / "b", "--quiet", terminal=True) == ("", "")
    assert (tmp_path / "b" / "steps.jsonl").stat().st_size > 0


@pytest.mark.parametrize(
    "demo, words, message",
    [
        *((demo, "--partition foo", "unknown partition 'foo'") for demo in REPORTING),
        ("manufactured", "--control foo", "unknown mode of the error control 'foo'"),
        ("hertz", "--true-error 0", "--true-error must be a positive number, got 0.0"),
    ],
)
def test_records_before_a_wrong_option(tmp_path, monkeypatch, capsys, demo, words, message):
    """A run that does not begin leaves the records of the one before as they are."""
    records = tmp_path / "steps.jsonl"
    records.write_text("before\n")
    path = DEMO.with_stem(demo)
    command = [str(path), *f"--order 2 --coarse 2 --output {tmp_path} {words}".split()]
    monkeypatch.setattr(sys, "argv", command)
    monkeypatch.syspath_prepend(path.parent)
    monkeypatch.delitem(sys.modules, "common", raising=False)
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(path), run_name="__main__")
    assert ended.value.code == 1 and message in capsys.readouterr().err
    assert records.read_text() == "before\n"


@pytest.mark.parametrize("options, cells, order", [((), 64, 6), (("--degree", "1"), 512, 3)])
def test_root_mesh_by_degree(tmp_path, options, cells, order):
    """Without other words the root mesh of the Hertz demo is that which fits the degree."""
    command = [sys.executable, DEMO, "--max-steps", "1", "--records-only", "--geometry-order", str(order)]
    subprocess.run([*command, "--output", tmp_path, *options], env=outside(), stdout=subprocess.DEVNULL, check=True)
    record = json.loads((tmp_path / "steps.jsonl").read_text())
    assert (record["cells"], record["geometry_order"]) == (cells, order)
