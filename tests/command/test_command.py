"""The command fx-contact: what it prints, and how programs end that it runs."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import WORLD, everywhere, outside
from model_problems import step_record

import fx_contact
from fx_contact import SweepRecord
from fx_contact.__main__ import main
from fx_contact.command import info, programs
from fx_contact.results import table_head, table_row

TOP = Path(__file__).parents[2]


@pytest.fixture
def say(capfd, monkeypatch):
    """Exit code, output and errors of a command line, on rank 0; nothing is said on others."""

    def said(*words):
        """What is said."""
        monkeypatch.setattr(sys, "argv", ["fx-contact", *map(str, words)])
        code = 0
        try:
            main()
        except SystemExit as end:
            code = end.code
        out, err = capfd.readouterr()
        everywhere(WORLD.rank == 0 or not out + err, "another rank speaks")
        return WORLD.bcast((code, out, err))

    return said


def record(step, **entries):
    """A record with figures that can be shown."""
    seconds = dict.fromkeys(("total", "solve"), 1.0 + step)
    figures = {"scene": "it", "dofs": 100 * 8**step, "estimate": 0.4 / 2**step, "tolerance": 0.1, "degree": 2}
    figures |= {"krylov_iterations": [3], "pair_forces": [], "seconds": seconds, "cpu_seconds": seconds}
    return step_record(step, **figures | entries)


@pytest.mark.ranks(1, 2)
@pytest.mark.parametrize("words", [["--help"], ["-h"], ["run", "--help"], ["show", "-h"], ["demo", "--help"]])
def test_help(say, words):
    """It lists all commands, and ends well."""
    code, out, err = say(*words)
    assert code == 0 and not err and all(f"  {name} " in out for name in ("run", "demo", "show", "info"))


@pytest.mark.ranks(1, 2)
@pytest.mark.parametrize(
    "words, why",
    [
        ([], "no command"),
        (["--hepl"], "unknown option '--hepl'"),
        (["inof"], "unknown command 'inof'; did you mean 'info'?"),
        (["run"], "run needs a program"),
        (["show"], "show needs one folder"),
        (["info", "all"], "info takes no arguments"),
    ],
)
def test_wrong_command_lines(say, words, why):
    """They are refused with what is wrong and the usage."""
    code, out, err = say(*words)
    assert code == 2 and not out and err.startswith(f"fx-contact: {why}\nusage:")


@pytest.mark.ranks(1, 2)
def test_errors_in_a_line(say, tmp_path, monkeypatch):
    """Without a traceback: no such program, no such demo, no demos at all, no records."""
    code, _, err = say("there/is/none.py")
    assert code == 1 and err.startswith("SceneError: there is no program 'there/is/none.py'") and err.count("\n") == 1
    assert "did you mean 'hertz'?" in say("demo", "hrtz")[2]
    assert "no steps.jsonl or sweep.jsonl in" in say("show", WORLD.bcast(tmp_path))[2]
    monkeypatch.setattr(programs, "__file__", "/usr/lib/python3/fx_contact/command/programs.py")
    monkeypatch.chdir("/")
    assert "call this in a clone of the project" in say("demo")[2]


@pytest.mark.ranks(1, 2)
def test_version_and_libraries(say, monkeypatch):
    """Versions of what results depend on; what is missing, and for what it is needed."""
    assert say("--version") == (0, f"fx_contact {fx_contact.__version__}\n", "")
    code, out, _ = say("info")
    known = dict(line.split(maxsplit=1) for line in out.replace("C compiler", "compiler").splitlines())
    assert code == 0 and known["fx_contact"] == fx_contact.__version__ and known["MPI"]
    assert {"Python", "dolfinx", "petsc", "hypre", "numpy", "gmsh", "matplotlib", "pyvista", "tqdm"} <= set(known)
    monkeypatch.setattr(info, "find_spec", lambda name: None)
    assert "tqdm        missing: needed for the live line of progress=True" in say("info")[1]


@pytest.mark.ranks(1)
def test_demos(say):
    """All programs in `demos`, each with its first sentence; what they import is none."""
    names = {line.split()[0] for line in say("demo")[1].splitlines()}
    files = {path.stem for path in (TOP / "demos").glob("*.py")}
    assert names == files - {"common", "manufactured_solution"} and len(names) > 8
    assert "Two elastic half-spheres" in say("demo")[1]


@pytest.mark.ranks(1, 2)
def test_records_of_a_run(say, tmp_path):
    """A table of the steps, the last one as a report, a plot of the errors; a line in the making is left out."""
    pytest.importorskip("matplotlib")
    folder, steps = WORLD.bcast(tmp_path), [record(0), record(1)]
    if WORLD.rank == 0:
        lines = [json.dumps(one.as_json()) + "\n" for one in steps]
        (folder / "steps.jsonl").write_text("".join(lines) + '{"scene": "it", "st')
    code, out, err = say("show", folder)
    assert code == 0, err
    assert out.splitlines()[:3] == [table_head(), *map(table_row, steps)]
    assert str(steps[1]) in out and out.endswith(f"pictures:\n  {folder / 'convergence.png'}\n")
    assert (folder / "convergence.png").stat().st_size > 1000
    WORLD.Barrier()
    for text, words in (("", "no record yet"), ("[]\n", "line 1 of"), ("{}\n", "line 1 of"), ("{\n", "line 1 of")):
        if WORLD.rank == 0:
            (folder / "steps.jsonl").write_text(text)
        WORLD.Barrier()
        code, _, err = say("show", folder)
        assert code == 1 and words in err, err


@pytest.mark.ranks(1, 2)
def test_records_of_a_load_path(say, tmp_path):
    """Its points by their values, with a curve of the force."""
    pytest.importorskip("matplotlib")
    folder, figures = WORLD.bcast(tmp_path), {"begun": "anew", "solves": 1, "unknowns": 0, "cpu_seconds": 0.0}
    points = [SweepRecord(point=i, value=0.5 + i, record=record(i), **figures) for i in range(2)]
    if WORLD.rank == 0:
        (folder / "sweep.jsonl").write_text("".join(json.dumps(one.as_json()) + "\n" for one in points))
    code, out, err = say("show", folder)
    assert code == 0, err
    assert out.splitlines()[2] == f"{'1.5':>12}  {table_row(points[1].record)}"
    assert (folder / "sweep.png").stat().st_size > 1000


#: Command lines of programs, with their exit code and what they say; some on two ranks.
PROGRAMS = {
    "with arguments": (["run", "program.py", "a", "--help"], 0, "program.py ['a', '--help'] from there\n"),
    "without the word": (["program.py", "b"], 0, "program.py ['b'] from there\n"),
    "exit": (["run", "program.py", "exit"], 3, ""),
    "error": (["run", "program.py", "error"], 1, ""),
}
PROGRAM = """
import sys
from beside import there
if "exit" in sys.argv: sys.exit(3)
if "error" in sys.argv: raise ValueError("of the program")
from mpi4py import MPI
if MPI.COMM_WORLD.rank == 0: print(sys.argv[0], sys.argv[1:], "from", there)
"""


@pytest.mark.skipif(WORLD.size > 1, reason="starts programs")
@pytest.mark.parametrize("name", PROGRAMS)
@pytest.mark.parametrize("ranks", [1, 2])
def test_programs(name, ranks, tmp_path):
    """They have their arguments and the modules beside them, and end with their own code."""
    words, code, said = PROGRAMS[name]
    (tmp_path / "program.py").write_text(PROGRAM)
    (tmp_path / "beside.py").write_text("there = 'there'")
    start = ["mpirun", "-n", "2"] if ranks == 2 else []
    command = [*start, sys.executable, "-m", "fx_contact", *words]
    done = subprocess.run(command, cwd=tmp_path, env=outside(), capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (code, said), done.stderr
    assert ("of the program" in done.stderr) == (name == "error")


@pytest.mark.skipif(WORLD.size > 1, reason="starts programs")
def test_no_abort(tmp_path):
    """Help of the command and of a demo on two ranks, once, without a word of MPI."""
    for words in (["--help"], ["demo", "hertz", "--help"]):
        command = ["mpirun", "-n", "2", sys.executable, "-m", "fx_contact", *words]
        done = subprocess.run(command, cwd=tmp_path, env=outside(), capture_output=True, text=True)
        assert done.returncode == 0 and done.stderr == "" and done.stdout.count("usage: ") == 1
