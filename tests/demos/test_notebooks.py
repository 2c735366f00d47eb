"""The notebooks run from top to bottom, show pictures, and are the same in both of their files."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import WORLD, outside

TOP = Path(__file__).parents[2]
NAMES = sorted(path.stem for path in (TOP / "notebooks").glob("*.ipynb"))
#: How many pictures each shows.
PICTURES = {
    "adaptive_loop": 4,
    "force_against_approach": 1,
    "hertz_in_five_minutes": 4,
    "hysteresis_loop": 2,
    "own_part": 1,
    "reading_work_precision": 1,
    "two_parts_meshed_apart": 3,
    "two_ranks": 2,
}
#: What is run instead: coarse meshes, and a run of each kind.
SMALLER = (
    (r'^ *"    Point\(.*(reference\(0\.08|one_level).*\n', ""),
    (r"tolerance=0\.[0-2]\d*", "tolerance=0.1"),
    (r"\bhertz\(", "hertz(coarse=2, "),
    (r"reference\(0\.04", "reference(0.8"),
    (r"--coarse 3", "--coarse 2"),
    (r"--uniform 1 --true-error 0\.25", "--coarse 3 --uniform 0 --true-error 0.6"),
)

pytestmark = pytest.mark.skipif(WORLD.size > 1, reason="a notebook starts its own processes")


def answers(name):
    """The programs that answer the exercises of a notebook, as narrow as its cells."""
    text = (TOP / "notebooks" / f"{name}.py").read_text()
    found = re.findall(r"^# ```python\n(.*?)^# ```", text, flags=re.M | re.S)
    lines = [line.removeprefix("#")[1:] for answer in found for line in answer.splitlines()]
    assert max(map(len, lines), default=0) <= 88
    return re.sub(r"tolerance=0\.[0-2]\d*", "tolerance=0.3", "\n".join(lines))


@pytest.mark.parametrize("name", NAMES)
def test_runs(name, tmp_path):
    """On coarse meshes, in a copy, so that its results go to a temporary folder; no cell fails or warns.

    Answers to its exercises run after its cells.
    """
    nbformat = pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel")
    for folder in ("notebooks", "demos", "studies", "src"):
        (tmp_path / folder).mkdir()
        for path in (TOP / folder).iterdir():
            (tmp_path / folder / path.name).symlink_to(path)
    notebook = tmp_path / "notebooks" / f"{name}.ipynb"
    text = notebook.read_text()
    for pattern, replacement in SMALLER:
        text = re.sub(pattern, replacement, text, flags=re.M)
    content = nbformat.reads(text, as_version=4)
    own = len(content.cells)
    content.cells.append(nbformat.v4.new_code_cell(answers(name), id="answers"))
    notebook.unlink()
    nbformat.write(content, notebook)
    command = [sys.executable, "notebooks/execute.py", notebook, "--output", "shown"]
    done = subprocess.run(command, cwd=tmp_path, env=outside(), capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-3000:]
    cells = nbformat.read(tmp_path / "shown" / f"{name}.ipynb", as_version=4).cells
    outputs = [out for cell in cells for out in cell.get("outputs", [])]
    pictures = [out for cell in cells[:own] for out in cell.get("outputs", []) if "image/png" in out.get("data", {})]
    assert len(pictures) == PICTURES[name]
    said = "".join(out.text for out in outputs if out.output_type == "stream" and out.name == "stderr")
    assert "Warning" not in said and "Error" not in said, said


@pytest.mark.parametrize("name", NAMES)
def test_both_files_say_the_same(name):
    """The .py for reading and comparing, the .ipynb for Jupyter, without outputs (`jupytext --sync` mends it)."""
    jupytext = pytest.importorskip("jupytext")
    script, notebook = (jupytext.read(TOP / "notebooks" / f"{name}.{kind}") for kind in ("py", "ipynb"))
    assert [(c.cell_type, c.source) for c in script.cells] == [(c.cell_type, c.source) for c in notebook.cells]
    assert not any(cell.get("outputs") or cell.get("execution_count") for cell in notebook.cells)


def test_all_are_known():
    """No notebook without its number of pictures."""
    assert NAMES == sorted(PICTURES) and len(NAMES) == 8
