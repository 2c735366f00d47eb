"""The work-precision study without its runs: medians, failures, interruptions, tables and plots."""

import json

import numpy as np
import pytest
from conftest import WORLD

pytestmark = pytest.mark.skipif(WORLD.size > 1, reason="the study is a serial program")


def line(point, repeat, wall, error):
    """A line of runs.jsonl as a run would leave it, some figures made up."""
    tolerance = (
        float(point.case.options.split("--tolerance ")[1].split()[0]) if "tolerance" in point.case.options else 1
    )
    last = {
        "dofs": int(2.0 / error**3),
        "estimate": 1.03 * error,
        "tolerance": tolerance,
        "force": 1.0,
        "versions": {},
    }
    last |= {"errors": {"force": error**2, "pressure": error}, "true_error": error}
    last |= {"l2_error": error**2, "effectivity": 1.03}
    history = [last]
    if point.case.demo == "hertz":
        last["true_error"] = {"relative": error}
    return {
        "command": point.case.command,
        "repeat": repeat,
        "date": "2025-01-01 00:00:00",
        "machine": {"processor": "a processor", "cores": 2},
        "wall": wall,
        "cpu": 2 * wall,
        "process_seconds": wall + 1,
        "last": last,
        "history": history,
    }


def test_commands_are_distinct():
    """No run is made twice, and the quick study is part of the full one."""
    from studies.work_precision.points import points

    full, quick = points(False), points(True)
    commands = [point.case.command for point in full]
    assert len(set(commands)) == len(commands) > len(quick) > 10
    assert {point.case.command for point in quick} < set(commands)
    assert all("--true-error" not in point.timing.options for point in full)


@pytest.mark.slow
def test_tables_and_plots(tmp_path):
    """Medians, a failure shown as one, and all plots that the results allow."""
    from studies.work_precision.figures import draw_all
    from studies.work_precision.points import points
    from studies.work_precision.tables import medians, promises, rows

    wanted = points(True)
    runs = [
        line(point, repeat, wall, 0.01 * (number + 1))
        for number, point in enumerate(wanted)
        for repeat, wall in enumerate((9.0, 1.0, 2.0))
    ]
    broken = wanted[1].case.command
    runs = [r for r in runs if r["command"] != broken]
    runs.append({"command": broken, "repeat": 0, "failed": "SolveError: no", "machine": {}, "date": "2025-01-01"})
    found = medians(wanted, runs)
    assert len(found) == len(wanted) and found[1].failed == "SolveError: no"
    assert all(r.wall == 2.0 and r.cpu == 4.0 and r.runs == 3 for r in found if not r.failed)
    table = list(rows(found))
    assert [r["failed"] for r in table if r["command"] == broken] == ["SolveError: no"]
    assert len(table) == len(found) and list(promises(found))
    names = draw_all(found, tmp_path, "a machine")
    assert {"work_precision.png", "settings.png", "tas.png", "estimate.png"} <= set(names)
    assert all(
        (tmp_path / name).with_suffix(kind).stat().st_size > 5000 for name in names for kind in (".png", ".svg")
    )


def test_measures():
    """Slope of a power law, digits of an error, and a promise with the figures that it is held against."""
    from studies.work_precision.tables import digits, medians, promises, slope

    x = np.array([1.0, 10.0, 300.0])
    assert slope(x, 5 * x**-0.4) == pytest.approx(-0.4) and digits(1e-3) == pytest.approx(3)
    from studies.work_precision.points import points

    wanted = [point for point in points(False) if point.line in ("adaptive, order 3, 2 ranks", "uniform, order 3")]
    runs = []
    for point in wanted:
        words = point.case.options.split()
        given = float(words[words.index("--tolerance") + 1])
        true, dofs = (0.9 * given, given**-3) if "--uniform" not in words else (0.2, 1e5)
        runs.append(line(point, 0, 2.0, true))
        runs[-1]["last"] |= {"tolerance": given, "dofs": dofs, "errors": {"force": 0.5 * true**2}}
    found = {row["promise"]: row["measured"] for row in promises(medians(wanted, runs))}
    assert found["true error at e = 4 %: 2 to 4.4 %"] == "3.60%"
    text = "; ".join(found.values())
    assert "power 2.00" in text and "0.50, 0.50" in text


def test_goes_on_where_it_stopped(tmp_path, monkeypatch):
    """What is in the file is not run again; a line cut short is; failures and long runs are not repeated."""
    from studies.work_precision import run as work_precision
    from studies.work_precision.points import points

    wanted = points(True)[:3]
    started = []

    def fake(point, repeat, folder):
        started.append((point.case.command, repeat))
        if point is wanted[1]:
            return {"command": point.case.command, "repeat": repeat, "failed": "no"}
        return line(point, repeat, 100.0 if point is wanted[2] else 1.0, 0.1)

    monkeypatch.setattr(work_precision, "one_run", fake)
    path = tmp_path / "runs.jsonl"
    path.write_text(json.dumps(line(wanted[0], 0, 1.0, 0.1)) + "\n" + '{"command": "mpi')
    work_precision.measure(wanted, tmp_path, 3)
    first, second, third = (point.case.command for point in wanted)
    assert started == [(first, 1), (first, 2), (second, 0), (third, 0)]
    assert len(work_precision.load(path)) == 5
    work_precision.measure(wanted, tmp_path, 3)
    assert len(started) == 4


def test_a_run_that_fails_or_hangs(tmp_path):
    """Errors of a demo come back as its own sentence; a run that takes too long is stopped."""
    from studies.runs import Case, RunFailed, run

    with pytest.raises(RunFailed, match="SceneError: the tolerance must be"):
        run(Case("hertz", "--tolerance -1 --order 2 --coarse 2 --records-only", 1), tmp_path / "a")
    with pytest.raises(RunFailed, match="not done after 1 s"):
        run(Case("hertz", "--tolerance 0.02 --records-only", 1), tmp_path / "b", limit=1.0)
