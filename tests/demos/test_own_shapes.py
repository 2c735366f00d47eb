"""The demos of own geometry: short, and right by known solutions."""

import ast
import json
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy
from conftest import WORLD, outside

DEMOS = Path(__file__).parents[2] / "demos"

pytestmark = pytest.mark.skipif(WORLD.size > 1, reason="a demo is a process of its own")


def is_short(path):
    """At most 69 lines beside the imports: 75 with those of a demo that takes six for them."""
    text = path.read_text()
    imports = [node for node in ast.walk(ast.parse(text)) if isinstance(node, (ast.Import, ast.ImportFrom))]
    return len(text.splitlines()) - sum(node.end_lineno - node.lineno + 1 for node in imports) <= 69


def last_record(name, folder, *options):
    """What the last step of a demo leaves, which without options shows it in pictures and fields."""
    path = DEMOS / f"{name}.py"
    assert is_short(path)
    command = [sys.executable, path, "--quiet", "--output", folder, *options, *["--records-only"] * bool(options)]
    done = subprocess.run(command, env=outside(), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert options or all(map(list, map(folder.glob, ("*.png", "*.vtu"))))
    return json.loads((folder / "steps.jsonl").read_text().splitlines()[-1])


def test_crossed_cylinders_are_hertz(tmp_path):
    """Through the force the ellipse and its pressure are Hertz's, to 0.2 %."""
    record = last_record("crossed_cylinders", tmp_path)
    assert record["reached"] and max(map(abs, record["errors"].values())) < 2e-3


def test_roller_is_hertz(tmp_path):
    """NAFEMS' benchmark CB-1."""
    record = last_record("roller_on_block", tmp_path)
    assert max(abs(record["errors"]["max_pressure"]), abs(record["errors"]["half-width"])) < 4e-3
    assert abs(record["errors"]["load"]) < 1e-4


@pytest.mark.parametrize("options", [(), ("--play", "0.0005")], ids=["play 0.002", "play 0.0005"])
def test_shaft_in_bore_is_persson(tmp_path, options):
    """The pressure is that of a shaft in a plate that is large enough, the force that of the load."""
    record = last_record("shaft_in_bore", tmp_path, *options)
    assert abs(record["errors"]["max_pressure"]) < 0.025
    assert abs(record["errors"]["load"]) < 1e-4


@pytest.mark.parametrize("options", [(), ("--rounding", "0.1")], ids=["rounding 1", "rounding 0.1"])
def test_rigid_stamp_is_sneddon(tmp_path, options):
    """On a block 30 times as wide and high as the stamp, the force is that on a half-space."""
    record = last_record("rigid_stamp", tmp_path, *options)
    assert record["reached"] and 0 < record["errors"]["force"] < 0.04


def test_fretting_is_mindlin(tmp_path):
    """Half a dozen nodes a radius: the stick radius to a third of their distance."""
    errors = last_record("fretting", tmp_path)["errors"]
    assert abs(errors["stick_radius"]) < 0.05 and abs(errors["displacement"]) < 0.02
    assert abs(errors["work_of_friction"]) < 0.1


def test_work_of_friction_is_the_area_of_the_loop(monkeypatch):
    """Mindlin's curve of unloading is that of loading, twice as large; a quarter of the area is of first loading."""
    monkeypatch.syspath_prepend(DEMOS)
    from mindlin_solution import Hertz, Material, Mindlin

    def at(shear):
        return Mindlin(Hertz(0.5, 0.5, 1.0), shear, 0.5, Material(1.0, 0.2))

    q = 0.4
    area = 2 * scipy.integrate.quad(lambda shear: at(q).displacement - 2 * at((q - shear) / 2).displacement, -q, q)[0]
    assert at(q).dissipated_energy == pytest.approx(abs(area) / 4, rel=1e-8)


def test_step_part_is_in_balance(tmp_path, monkeypatch):
    """From CAD to a picture: round sides are round, and the contact carries the pull of the pin."""
    path = DEMOS / "step_part.py"
    assert is_short(path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", [str(path)])
    found = runpy.run_path(str(path))
    mesh, step = found["scene"].mesh, found["step"]
    for side, radius in (("bolt radius 12", 12.0), ("pin radius 11.9", 11.9)):
        nodes = mesh.facet_points(mesh.surface(side)).reshape(-1, 3)
        assert np.allclose(np.hypot(nodes[:, 0], nodes[:, 2]), radius, atol=1e-9)
    (contact,) = (one for one in step.resultants if one.kind == "contact")
    assert step.record.reached and abs(abs(contact.force[2]) / found["PULL"] - 1) < 1e-3
    assert (tmp_path / "results" / "step_part" / "stress.png").stat().st_size > 10_000


def test_a_part_alone_has_no_whole(tmp_path):
    """A demo that models a part only has no option that asks for the whole."""
    command = [sys.executable, DEMOS / "shaft_in_bore.py", "--symmetry", "full", "--output", tmp_path]
    done = subprocess.run(command, env=outside(), capture_output=True, text=True)
    assert done.returncode == 2 and "unknown option '--symmetry'" in done.stderr
