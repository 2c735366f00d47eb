"""The command fx-contact: what it prints, and how programs end that it runs."""

import subprocess
import sys
from pathlib import Path

import pytest
from conftest import WORLD, everywhere, outside

import fx_contact
from fx_contact.__main__ import main
from fx_contact.command import info

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


@pytest.mark.ranks(1, 2)
@pytest.mark.parametrize("words", [["--help"], ["-h"], ["run", "--help"], ["info", "-h"]])
def test_help(say, words):
    """It lists all commands, and ends well."""
    code, out, err = say(*words)
    assert code == 0 and not err and all(f"  {name} " in out for name in ("run", "info"))


@pytest.mark.ranks(1, 2)
@pytest.mark.parametrize(
    "words, why",
    [
        ([], "no command"),
        (["--hepl"], "unknown option '--hepl'"),
        (["inof"], "unknown command 'inof'; did you mean 'info'?"),
        (["run"], "run needs a program"),
        (["info", "all"], "info takes no arguments"),
    ],
)
def test_wrong_command_lines(say, words, why):
    """They are refused with what is wrong and the usage."""
    code, out, err = say(*words)
    assert code == 2 and not out and err.startswith(f"fx-contact: {why}\nusage:")


@pytest.mark.ranks(1, 2)
def test_errors_in_a_line(say):
    """Without a traceback: there is no such program."""
    code, _, err = say("there/is/none.py")
    assert code == 1 and err.startswith("SceneError: there is no program 'there/is/none.py'") and err.count("\n") == 1


@pytest.mark.ranks(1, 2)
def test_version_and_libraries(say, monkeypatch):
    """Versions of what results depend on; what is missing, and for what it is needed."""
    assert say("--version") == (0, f"fx_contact {fx_contact.__version__}\n", "")
    code, out, _ = say("info")
    known = dict(line.split(maxsplit=1) for line in out.replace("C compiler", "compiler").splitlines())
    assert code == 0 and known["fx_contact"] == fx_contact.__version__ and known["MPI"]
    assert {"Python", "dolfinx", "petsc", "hypre", "numpy", "gmsh", "matplotlib", "pyvista"} <= set(known)
    monkeypatch.setattr(info, "find_spec", lambda name: None)
    assert "matplotlib  missing: needed for curves and maps" in say("info")[1]


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
    for words in (["--help"], [str(TOP / "demos" / "hertz.py"), "--help"]):
        command = ["mpirun", "-n", "2", sys.executable, "-m", "fx_contact", *words]
        done = subprocess.run(command, cwd=tmp_path, env=outside(), capture_output=True, text=True)
        assert done.returncode == 0 and done.stderr == "" and done.stdout.count("usage: ") == 1
