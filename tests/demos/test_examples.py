"""The programs of the pages of examples, as printed: short, and right by their references."""

import io
import re
import runpy
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np
import pytest
from conftest import WORLD

from studies.pictures.run import EXAMPLES, program

TOP = Path(__file__).parents[2]
PAGES = sorted(EXAMPLES.glob("*.md"))
NAMES = [page.stem for page in PAGES if page.stem != "index"]

serial = pytest.mark.skipif(WORLD.size > 1, reason="programs of one process")


def text(name):
    """A page."""
    return (EXAMPLES / f"{name}.md").read_text()


def numbers(line):
    """Numbers of a line."""
    return np.array(re.findall(r"\d[\d.]*(?:e[-+]\d+)?", line), dtype=float)


def result(name, folder):
    """What the program of a page defines, and the numbers of each line that it prints; the list has the same."""
    path, out = folder / f"{name}.py", io.StringIO()
    path.write_text(program(EXAMPLES / f"{name}.md"))
    with redirect_stdout(out):
        found = runpy.run_path(str(path))
    lines = [numbers(line) for line in out.getvalue().splitlines()]
    (row,) = (line for line in text("index").splitlines() if f"]({name}.md)" in line)
    for value in numbers(row.split("|")[-2]):
        assert np.isclose(np.concatenate(lines), value, rtol=5e-3).any(), f"{value} in the list"
    return found, lines


@pytest.mark.parametrize("name", NAMES)
def test_pages(name):
    """A program of 40 lines of 88 characters, a picture of its own, a place in the list."""
    lines = program(EXAMPLES / f"{name}.md").splitlines()
    assert len(lines) <= 40 and max(map(len, lines)) <= 88
    index = text("index")
    assert f"../figures/scene_{name}.png" in text(name) and f"]({name}.md)" in index and f"\n{name}\n" in index


def test_list():
    """All eight."""
    assert len(NAMES) == 8


@serial
def test_coated_half_space(tmp_path):
    """The force is between Hertz's, the effective modulus between Reuss' and Voigt's."""
    found, _ = result("coated_half_space", tmp_path)
    assert found["step"].record.reached
    assert found["soft"] < found["force"] / found["hertz"] < found["stiff"]
    assert found["low"] < found["effective"] < found["high"]


@serial
def test_bimetal_strip(tmp_path):
    """The free end changes the deflection by less than (h / l)^2."""
    found, _ = result("bimetal_strip", tmp_path)
    assert found["step"].record.reached
    assert abs(found["ratio"] - 1) < (found["h"] / found["length"]) ** 2


@serial
def test_bolted_flange(tmp_path):
    """Equilibrium; before the joint opens the tension grows by the load factor, to half of the squared tolerance.

    The clamping force is 0 at the largest load.  Circles of the mesh take 0.04 % off the load.
    """
    found, lines = result("bolted_flange", tmp_path)
    load, clamp, stud, diagram = np.array(lines).T
    assert found["step"].record.reached and (load == [10e3, 25e3]).all()
    assert stud - clamp == pytest.approx(load, rel=5e-4)
    assert stud[0] - 20e3 == pytest.approx(diagram[0] - 20e3, rel=0.05) and clamp[1] == 0


@serial
def test_press_fit(tmp_path):
    """Open at first; then Lame's pressure, to the square of the tolerance."""
    _, lines = result("press_fit", tmp_path)
    cooled, pressure, lame = np.array(lines).T
    assert (cooled == [50, 100, 150, 200]).all() and pressure[0] == lame[0] == 0
    assert pressure[1:] == pytest.approx(lame[1:], rel=0.05**2)


@serial
def test_sandwich_beam(tmp_path):
    """Below Allen's by the bending of the skins, lambda / l, and what is local to the support, (c / l)^2."""
    found, _ = result("sandwich_beam", tmp_path)
    assert found["step"].record.reached
    thin = np.sqrt(found["young"] * found["t"] ** 3 / 6 / (found["modulus"] * found["d"] ** 2 / found["c"]))
    assert thin == pytest.approx(3.3, abs=0.05)
    assert -thin / found["length"] - (found["c"] / found["length"]) ** 2 < found["ratio"] - 1 < 0


@serial
def test_rubber_seal(tmp_path):
    """Gent and Lindley's modulus, an approximation, within 2 %; the difference is 0.8 %."""
    found, _ = result("rubber_seal", tmp_path)
    assert found["step"].record.reached
    assert abs(found["ratio"] - 1) < 0.02


@serial
def test_fretting(tmp_path):
    """The stick radius is Cattaneo's to half the distance of nodes, also before the ball moves, when all sticks."""
    found, lines = result("fretting", tmp_path)
    shear, radius, cattaneo = np.array(lines).T
    assert found["step"].record.reached and shear[:2] == pytest.approx(0, abs=1e-3) and 0 < shear[2] < 1
    assert radius == pytest.approx(cattaneo, abs=0.05)


@serial
def test_bolt_through_two_plates(tmp_path):
    """The guide on preload: the tension to 1e-6, the closing between the bounds of springs in series.

    Bolt and plates as rods, F L / (E A): shank and whole plates are the stiffest, the bolt with its heads (VDI 2230
    adds half a diameter for each) and a sleeve below the heads the softest.
    """
    path = tmp_path / "preload.py"
    path.write_text(program(TOP / "docs/howto/preload.md"))
    with redirect_stdout(io.StringIO()):
        found = runpy.run_path(str(path))
    forces = [one.force[2] for one in found["tightened"].resultants if one.kind in ("contact", "tie")]
    assert np.abs(forces) == pytest.approx(20e3, rel=1e-6)
    strain = 20e3 / 210e3 / np.pi
    stiff = 20 / 4**2 + 20 / (16**2 - 4.5**2)
    soft = (20 + 2 * 4) / 4**2 + 20 / (7**2 - 4.5**2)
    assert strain * stiff < found["closing"] < strain * soft


@serial
def test_gasketed_joint(tmp_path, monkeypatch):
    """Both interfaces bear the load; the seal pressure is that of the disc's facets, and larger beside the load."""
    pytest.importorskip("gmsh")
    monkeypatch.chdir(tmp_path)
    found, lines = result("gasketed_joint", tmp_path)
    record, (mean, area, least, largest) = found["step"].record, lines[-1]
    assert record.reached and set(record.free_motions) == {"base", "gasket", "lid"} and not record.doubts
    assert record.pair_forces == pytest.approx([1000.0, 1000.0], rel=0.01)
    assert record.pair_forces[0] == pytest.approx(record.pair_forces[1], rel=1e-6)
    assert mean == pytest.approx(area, rel=0.01) and least < mean < largest < 1.1 * least
