"""The partition study from end to end on small meshes: scores, kernels, prediction, tables, pictures."""

import sys
from pathlib import Path

import pytest
from conftest import WORLD, everywhere

from fx_contact.forest.partition import KINDS
from fx_contact.scenes import hertz
from studies.partition import run as partition_study
from studies.partition.cluster_model import STAGES, TIMES, measure
from studies.tables import read


@pytest.fixture
def study(monkeypatch):
    """The module of the demo, with one small benchmark."""
    small = {"hertz": (hertz, (0.3, 0.3), 18.3e6, 0.25)}
    monkeypatch.setattr(partition_study, "BENCHMARKS", small)
    monkeypatch.setattr(partition_study, "TOLERANCE", 0.3)
    return partition_study


@pytest.fixture(scope="module")
def kernels():
    """The kernels as measured here, once."""
    return measure(0.3)


@pytest.mark.skipif(WORLD.size != 2, reason="each rank scores a benchmark by itself: two show all")
def test_study(study, kernels, monkeypatch, tmp_path):
    """It runs; sfc alone splits pairs; what is predicted is positive and adds up."""
    folder = Path(WORLD.bcast(str(tmp_path)))
    monkeypatch.setattr(sys, "argv", ["run.py", "--parts", "32", "--output", str(folder)])
    monkeypatch.setattr(study, "measure", lambda *known: kernels)
    study.main()
    if WORLD.rank > 0:
        return
    _, rows = read(folder / "quality.csv")
    assert len(rows) == 5 * len(KINDS)
    for row in rows:
        assert (row["kind"] == "sfc") == (row["split_pairs"] > 0), row
    _, rows = read(folder / "model.csv")
    assert [row["parts"] for row in rows] == [32]
    for row in rows:
        stages = [row[name] for name in STAGES]
        assert min(stages) > 0 and sum(stages) == pytest.approx(row["total"], rel=1e-5)  # six digits are kept
    for name in ("cut", "hertz_32", *(f"hertz_{kind}_32" for kind in KINDS)):
        assert (folder / f"{name}.png").stat().st_size > 10_000, name


@pytest.mark.parametrize(
    "options, words",
    [("--parts 100", "power of two"), ("--parts 65536", "at most half"), ("--output /dev/null/x", "name another")],
)
def test_bad_options(study, monkeypatch, tmp_path, capsys, options, words):
    """One line that says what to do, and no traceback."""
    monkeypatch.setattr(sys, "argv", ["run.py", "--output", str(tmp_path), *options.split()])
    monkeypatch.setattr(study, "draw_in_32", lambda *_: None)
    with pytest.raises(SystemExit) as exit_code:
        study.main()
    assert exit_code.value.code in (1, 2)
    if WORLD.rank == 0:
        text = capsys.readouterr().err
        assert words in text and "Traceback" not in text


@pytest.mark.skipif(WORLD.size != 2, reason="two ranks show all")
def test_kernels(kernels):
    """All kernels are measured to be positive."""
    for name in TIMES:
        everywhere(kernels[name] > 0, name)
