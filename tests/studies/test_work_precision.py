"""The work-precision study without its runs: medians, failures, interruptions, tables and plots."""

import json

import numpy as np
import pytest
from conftest import WORLD

from studies.runs import Case, RunFailed, run
from studies.work_precision import run as work_precision
from studies.work_precision.figures import draw
from studies.work_precision.points import INDENT_A, points, true_error_of_indentation
from studies.work_precision.tables import medians, promises, rows, slope, true_errors_of_hertz

pytestmark = pytest.mark.skipif(WORLD.size > 1, reason="the study is a serial program")


def line(point, repeat, wall, error):
    """A line of runs.jsonl as a run would leave it, some figures made up."""
    words = point.case.options.split()
    tolerance = float(words[words.index("--tolerance") + 1]) if "--tolerance" in words else 1
    last = {"dofs": int(80 / error**1.5), "estimate": 1.03 * error, "tolerance": tolerance, "versions": {}}
    last |= {"errors": {"force": error**2, "max_pressure": error}, "true_error": error, "l2_error": error**2}
    last |= {"force": INDENT_A * (1 + error**2), "effectivity": 1.03, "peak_memory_bytes": 10**9}
    history = [last | {"krylov_iterations": [4, 12], "cpu": {"setup": 0.25 * wall, "solve": wall}}]
    return {
        "command": point.case.command,
        "repeat": repeat,
        "date": "2025-01-01 00:00:00",
        "machine": "a processor, 2 cores",
        "wall": wall,
        "cpu": 2 * wall,
        "process_seconds": wall + 1,
        "last": last,
        "history": history,
    }


def results(wanted, runs):
    """Medians of runs, with the true errors that `line` makes up for HERTZ-A too."""
    lines = {point.case.command: point.line for point in wanted}
    good = [one for one in runs if "failed" not in one]
    return medians(
        wanted, runs, {(lines[one["command"]], one["last"]["dofs"]): one["last"]["true_error"] for one in good}
    )


def test_commands_are_distinct():
    """No run is made twice, and the quick study is part of the full one."""
    full, quick = points(False), points(True)
    commands = [point.case.command for point in full]
    assert len(set(commands)) == len(commands) > len(quick) > 9
    assert {point.case.command for point in quick} < set(commands)


def test_tables_and_plots(tmp_path):
    """Medians, a failure shown as one, and all plots that the results allow."""
    wanted = points(True)
    runs = [
        line(point, repeat, wall, 0.01 * (number + 1))
        for number, point in enumerate(wanted)
        for repeat, wall in enumerate((9.0, 1.0, 2.0))
    ]
    broken = wanted[1].case.command
    runs = [r for r in runs if r["command"] != broken]
    runs.append({"command": broken, "repeat": 0, "failed": "SolveError: no", "machine": "", "date": "2025-01-01"})
    found = results(wanted, runs)
    assert len(found) == len(wanted) and found[1].failed == "SolveError: no"
    assert all(r.wall == 2.0 and r.cpu == 4.0 and r.runs == 3 for r in found if not r.failed)
    table = list(rows(found))
    assert [r["failed"] for r in table if r["command"] == broken] == ["SolveError: no"]
    assert len(table) == len(found) and list(promises(found))
    draw(found, tmp_path, "a machine")
    assert all((tmp_path / f"work_precision.{kind}").stat().st_size > 5000 for kind in ("png", "svg"))


def test_measures():
    """Slope of a power law, and promises with the figures that they are held against."""
    x = np.array([1.0, 10.0, 300.0])
    assert slope(x, 5 * x**-0.4) == pytest.approx(-0.4)
    assert true_error_of_indentation(INDENT_A * 1.0004) == pytest.approx(0.02)
    wanted = points(False)
    runs = []
    for point in wanted:
        words = point.case.options.split()
        given, degree = float(words[words.index("--tolerance") + 1]), 1 if "--degree 1" in point.case.options else 2
        error, seconds = 0.8 * given, given ** (-3 / degree)
        runs.append(line(point, 0, seconds, error))
    found = {row["promise"]: row["measured"] for row in promises(results(wanted, runs))}
    assert found["HERTZ-A: energy error like N^(-0.62)"] == "N^(-0.67)"
    reached = found["HERTZ-A: true error 1.0% with at most 130,000 dofs and 15 CPU s"]
    assert reached == "0.80% with 111,803 dofs, 2000.0 CPU s, 1.0 GB"
    cost = {degree: 2 * (0.03 / 0.8) ** (-3 / degree) for degree in (1, 2)}
    text = found["INDENT-A: true error 3 % in a quarter of degree 1's CPU"]
    assert text == f"degree 1 {cost[1]:.0f} CPU s, degree 2 {cost[2]:.0f} CPU s: {cost[2] / cost[1]:.2f}"


def test_true_errors_are_kept():
    """Each line of HERTZ-A has some; those of degree 2 reach 0.1 %."""
    kept, lines = true_errors_of_hertz(), {point.line for point in points(False) if point.group == "HERTZ-A"}
    assert {name for name, _ in kept} == lines
    values = [error for (name, _), error in kept.items() if name == "degree 2"]
    assert min(values) < 0.0011 and max(values) < 0.1


def test_goes_on_where_it_stopped(tmp_path, monkeypatch):
    """What is in the file is not run again; a line cut short is; failures and long runs are not repeated."""
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
    with pytest.raises(RunFailed, match="SceneError: the tolerance must be"):
        run(Case("hertz", "--tolerance -1 --order 2 --coarse 2 --records-only", 1), tmp_path / "a")
    with pytest.raises(RunFailed, match="not done after 1 s"):
        run(Case("hertz", "--tolerance 0.02 --records-only", 1), tmp_path / "b", limit=1.0)
