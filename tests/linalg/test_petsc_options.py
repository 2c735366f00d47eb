"""PETSc's own habits: options from a dict and from the command line, monitors, -log_view with our stages, -help."""

import ctypes
import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import WORLD, outside

from fx_contact import SceneError, Solver, adapt
from fx_contact.linalg import ladder, petsc_objects, solver_options
from fx_contact.parallel.timing import STAGES
from fx_contact.scenes import patch

pytestmark = pytest.mark.skipif(WORLD.size > 1, reason="starts programs")
DEMO = Path(__file__).parents[2] / "demos" / "hertz.py"
PROGRAM = """
import sys, petsc4py
petsc4py.init(sys.argv)
from fx_contact import Solver, adapt
from fx_contact.linalg import petsc_objects
from fx_contact.scenes import patch
*_, step = adapt(patch(cells=(1, 1, 2)), 0.1, solver=Solver(options={"pc_type": "jacobi", "ksp_view": None}))
"""


def output(*command):
    """What a program writes."""
    plain = outside() | {"PYTHON_COLORS": "0"}
    done = subprocess.run(command, env=plain, capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stderr
    return done.stdout


def demo(tmp_path, words, ranks=1):
    """What the Hertz demo writes, small, with options of PETSc."""
    run = f"mpirun -n {ranks}".split() + [sys.executable, DEMO]
    small = f"--order 2 --coarse 2 --tolerance 0.4 --displacement 0.05 --records-only --output {tmp_path}"
    return output(*run, *small.split(), *words.split())


def test_options_of_a_dict_and_of_the_command_line():
    """The dict replaces the program's option, the command line that of the dict."""
    kinds = [
        re.findall(r"PC Object: \(fx_\).*\n +type: (\w+)", output(sys.executable, "-c", PROGRAM, *words))
        for words in ((), ("-fx_pc_type", "bjacobi"))
    ]
    assert [set(kind) for kind in kinds] == [{"jacobi"}, {"bjacobi"}]


@pytest.mark.parametrize(
    "solver, used",
    [
        ({}, "p-multigrid"),
        ({"preconditioner": "boomeramg"}, "boomeramg"),
        ({"preconditioner": "ilu"}, "ilu"),
        ({"preconditioner": "boomeramg-robust"}, "boomeramg-robust"),
        ({"options": {"pc_type": "jacobi"}}, "jacobi"),
        ({"options": {"pc_type": "gamg"}}, "gamg"),
        ({"options": {"pc_type": "hypre"}}, "boomeramg"),
        ({"preconditioner": "cholesky", "options": {"pc_type": "lu"}}, "lu"),
        ({"preconditioner": "boomeramg", "options": {"pc_hypre_type": "euclid"}}, "euclid"),
    ],
)
def test_record_names_what_was_used(solver, used):
    """Not what the program would have taken, where options have put another preconditioner in its place."""
    assert next(adapt(patch(cells=(1, 1, 2)), 0.1, solver=Solver(**solver))).record.preconditioner == used


def test_without_hypre(monkeypatch):
    """As with PETSc of wheels: degree 1 and large coarse levels take GAMG, what needs hypre is refused or left out."""
    for module in (ladder, solver_options):
        monkeypatch.setattr(module, "ALGEBRAIC", "gamg")
    with pytest.raises(SceneError, match="no hypre here, which 'ilu' needs: take 'gamg'"):
        Solver("ilu")
    assert next(adapt(patch(cells=(1, 1, 2)), 0.1, degree=1)).record.preconditioner == "gamg"
    assert solver_options.preconditioner_options("p-multigrid", 10**6)["mg_coarse_pc_type"] == "gamg"
    assert ladder.fallback(WORLD, 100, "gamg") == "cholesky"
    monkeypatch.setattr(ladder, "shortage", lambda *_: "no memory")
    assert ladder.fallback(WORLD, 100, "gamg") is None


@pytest.mark.parametrize("smoother", ["l1scaled-Jacobi", "Chebyshev"])
def test_smoother_of_all_levels(smoother):
    """What sets several options at once wins over the defaults of each, in a dict and on the command line."""
    program = PROGRAM.replace("Solver(", 'Solver("boomeramg", ')
    typed = program.replace('"pc_type": "jacobi", ', "")
    program = program.replace('"pc_type": "jacobi"', f'"PC_HYPRE_boomeramg_relax_type_all": "{smoother}"')
    for words in ((program,), (typed, "-fx_pc_hypre_boomeramg_relax_type_all", smoother)):
        log = output(sys.executable, "-c", *words)
        kinds = re.findall(r"Relax (?:down|up) +(\S+)", log)
        assert set(kinds) == {smoother}, log


def test_log_view_has_our_stages(tmp_path):
    """All stages of a step are stages of PETSc's log, on several ranks; the solve has its flops."""
    log = demo(tmp_path, "-log_view", 2)
    summary = log[log.index("Summary of Stages") :]
    seen = re.findall(r"^ *\d+: +fx (\w+):", summary, re.MULTILINE)
    assert set(seen) == set(STAGES) - {"other", "output"}, "nothing was written"
    flops = {name: float(value) for name, value in re.findall(r"fx (\w+): +\S+ +\S+% +(\S+)", summary)}
    assert max(flops, key=flops.get) == "solve"


def test_monitor(tmp_path):
    """The monitor of the solver prints a line for every iteration."""
    log = demo(tmp_path, "-fx_ksp_monitor -fx_ksp_converged_reason")
    assert len(re.findall(r"^ +\d+ KSP Residual norm", log, re.MULTILINE)) > 5 and "Linear fx_ solve converged" in log


def test_monitor_goes_on_with_what_takes_over():
    """Where PCG fails, the preconditioner that takes over is watched by the same options."""
    own = '{"pc_type": "jacobi", "ksp_view": None}'
    failing = PROGRAM.replace(own, '{"KSP_converged_reason": None}, max_krylov=3')
    log = output(sys.executable, "-c", failing.replace("(1, 1, 2)", "(3, 3, 3)").replace("0.1", "1e-3, max_steps=1"))
    assert "Linear fx_ solve did not converge" in log and "Linear fx_fallback_ solve converged" in log, log


def test_help(tmp_path):
    """-help lists PETSc's options under the solver's prefix, as the program has set them; --help is the demo's."""
    log = demo(tmp_path, "-help -fx_mg_coarse_pc_hypre_boomeramg_max_iter 1")  # else the coarse level has factors
    assert "-fx_ksp_max_it" in log and "-fx_mg_coarse_pc_hypre_boomeramg_strong_threshold: <now 0.7" in log
    assert "usage: hertz.py" in demo(tmp_path, "--help")


@pytest.mark.parametrize("kind", [ctypes.c_int, ctypes.c_bool])
def test_type_of_petsc_bool(monkeypatch, kind):
    """By the bytes that PETSc writes: of an int, or of one byte."""
    true = bytes(kind(True))

    class Library:
        """PETSc of some release."""

        def __init__(self, _):
            """Loaded."""

        def PetscInitialized(self, place):  # noqa: N802
            """Writes a PetscBool."""
            ctypes.memmove(place, true, len(true))

    monkeypatch.setattr(petsc_objects.ctypes, "CDLL", Library)
    assert petsc_objects.bool_type() is kind
