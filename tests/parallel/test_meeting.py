"""Ranks that go astray: each is named in a sentence, and nobody waits for ever."""

import importlib
import inspect
import logging
import subprocess
import sys
import time
from dataclasses import replace

import pytest
from conftest import everywhere, outside
from mpi4py import MPI

from fx_contact import Beginning, Checkpoint, RootMesh, adapt, increments, root_mesh_from_file, scenes, solve, sweep
from fx_contact.parallel import meeting
from fx_contact.parallel.errors import CallError
from fx_contact.parallel.meeting import calling, collective
from fx_contact.plot import draw_convergence, draw_mesh, draw_pressure, draw_stress
from fx_contact.results import RecordWriter, true_error, write_fields

COMM = MPI.COMM_WORLD
#: Where one rank goes another way: the last one, or the one to which all others speak.
ASTRAY = pytest.mark.parametrize("astray", [COMM.size - 1, 0], ids=["last", "first"])
several = pytest.mark.skipif(COMM.size == 1, reason="one rank has no others")


@pytest.fixture(scope="module")
def run():
    """A run after its first step."""
    made = adapt(scenes.patch(cells=(2, 2, 2)), 0.01, degree=1)
    next(made)
    return made


FIELDS = "write_fields of step 0"
#: Calls by name, with a run and a folder.
CALLS = {
    "adapt": lambda run, folder: adapt(run.step.scene, 0.1),
    "solve": lambda run, folder: solve(run.step.scene, 0.1),
    "the next step of adapt": lambda run, folder: next(run),
    "sweep": lambda run, folder: sweep(lambda _: run.step.scene, [1.0], 0.1),
    "increments": lambda run, folder: increments(lambda _: run.step.scene, [1.0], 0.1),
    FIELDS: lambda run, folder: write_fields(run.step, folder),
    "true_error of step 0": lambda run, folder: true_error(run.step, 0.01),
    "RecordWriter": lambda run, folder: RecordWriter(folder, COMM),
    "Checkpoint": lambda run, folder: Checkpoint(folder, run.step.scene, COMM),
    "Beginning.uniform": lambda run, folder: Beginning.uniform(run.step.scene, 1),
    "Beginning.after of step 0": lambda run, folder: Beginning.after(run.step, None),
    "root_mesh_from_file": lambda run, folder: root_mesh_from_file(COMM, "a.msh"),
    "RootMesh.from_dolfinx": lambda run, folder: RootMesh.from_dolfinx(None, None, None, {}, {}),
    "Step.stress of step 0": lambda run, folder: run.step.stress,
    "Step.nodal_stress of step 0": lambda run, folder: run.step.nodal_stress,
    "Step.to_pyvista of step 0": lambda run, folder: run.step.to_pyvista(),
    "Step.facet_tags of step 0": lambda run, folder: run.step.facet_tags,
    "Step.ds of step 0": lambda run, folder: run.step.ds("top"),
    "ContactTable.gathered": lambda run, folder: run.step.contact.gathered(),
    "draw_mesh of step 0": lambda run, folder: draw_mesh(run.step, folder / "a.png"),
    "draw_pressure of step 0": lambda run, folder: draw_pressure(run.step, folder / "a.png"),
    "draw_stress of step 0": lambda run, folder: draw_stress(run.step, folder / "a.png"),
    "draw_convergence": lambda run, folder: draw_convergence(run.records, folder / "a.png"),
}


@several
@ASTRAY
@pytest.mark.parametrize("name", CALLS)
def test_another_call(run, tmp_path, name, astray):
    """Each call on one rank, while the others go on with another: both are named on all ranks, and nothing is done."""
    other = FIELDS if name != FIELDS else "draw_mesh of step 0"
    start = time.monotonic()
    with pytest.raises(CallError) as caught:
        CALLS[name if COMM.rank == astray else other](run, tmp_path)
    said, others = str(caught.value), [rank for rank in range(COMM.size) if rank != astray]
    assert f"{name} on rank {astray}" in said
    assert f"{other} on rank{'s' * (len(others) > 1)} {', '.join(map(str, others))}" in said
    assert time.monotonic() - start < 5 and not list(tmp_path.iterdir())
    assert len(set(COMM.allgather(said))) == 1
    everywhere(run.step.nodal_displacement.shape[1:] == (8, 3), "they go on together")


@several
@ASTRAY
def test_another_step(run, tmp_path, astray):
    """The same call of another step is another call."""
    step = replace(run.step, record=replace(run.step.record, step=3)) if COMM.rank == astray else run.step
    with pytest.raises(CallError, match=f"draw_mesh of step 3 on rank {astray}"):
        draw_mesh(step, tmp_path / "a.png")


@several
@ASTRAY
def test_failed_before(astray):
    """A rank that has failed alone inside a call, and goes on: the others hear of it at their next one."""
    if COMM.rank == astray:
        with pytest.raises(MemoryError), calling(COMM, "the first"):
            raise MemoryError
    else:
        with calling(COMM, "the first"):
            pass
        with pytest.raises(CallError, match=f"an error in the first on rank {astray}"), calling(COMM, "the second"):
            raise AssertionError
    with calling(COMM, "the third"):
        pass


@several
def test_failed_alike():
    """What all ranks raise inside a call is raised as it is, and each goes on."""
    for _ in range(3):
        with pytest.raises(ZeroDivisionError), calling(COMM, "a call"):
            raise ZeroDivisionError
    with calling(COMM, "the next one"):
        pass


@several
def test_calls_inside_a_call():
    """They have no meeting: a rank may make other ones than the rest.  Nor has a call on one rank."""
    with calling(COMM, "outside"):
        if COMM.rank == 0:
            with calling(COMM, "inside"):
                pass
    if COMM.rank == 0:
        with calling(MPI.COMM_SELF, "alone"):
            pass
    half = COMM.Split(COMM.rank == 0)
    with calling(half, f"half {COMM.rank == 0}"), calling(COMM, "all"):
        pass
    half.Free()


@several
@pytest.mark.parametrize(
    "late", [(COMM.size - 1,), (0,), tuple(range(COMM.size - 1))], ids=["last", "first", "all but the last"]
)
def test_late(late, monkeypatch, caplog):
    """Who works alone is waited for; of the first two ranks those that wait say so, once."""
    monkeypatch.setattr(meeting, "_PATIENCE", 0.2)
    COMM.Barrier()
    start = time.monotonic()
    if COMM.rank in late:
        time.sleep(0.8)
    with caplog.at_level(logging.WARNING, "fx_contact"), calling(COMM, "a call"):
        waited = time.monotonic() - start
    waits = COMM.rank < 2 and COMM.rank not in late
    assert caplog.messages == [f"rank {COMM.rank} waits in a call since 0.2 s: all ranks must make it"] * waits
    assert waited > 0.7


@several
def test_in_time(caplog):
    """Nothing is said before the patience ends."""
    if COMM.rank == 0:
        time.sleep(0.3)
    with caplog.at_level(logging.WARNING, "fx_contact"), calling(COMM, "a call"):
        pass
    assert not caplog.messages


HEAD = """
import sys, time
from mpi4py import MPI
from fx_contact import adapt, solve
from fx_contact.parallel import meeting
from fx_contact.results import write_fields
from fx_contact.scenes import patch
meeting._GRACE = 1.0
comm = MPI.COMM_WORLD
last = comm.rank == comm.size - 1
"""
RUN = HEAD + "scene = patch(cells=(2, 2, 2))\nrun = adapt(scene, 1e-3, degree=1, max_steps=3{})\n"
#: What a rank does inside a step, where the others wait for it in messages of their own.
INSIDE = (
    "def progress(step, stage):\n    if last and stage == 'estimate':\n        {}\n"
    + RUN.format(", progress=progress")
    + "for step in run:\n    pass\n"
)
END, STEP = "the end of the program", "the next step of adapt"
#: Ways of one rank out of a program: text, what stderr has, ranks.
ENDS = {
    "only rank 0": (
        HEAD + "if comm.rank == 0: next(adapt(patch(), 1e-3))",
        ["adapt on rank 0", f"{END} on rank 1"],
        2,
    ),
    "only the last": (HEAD + "if last: next(adapt(patch(), 1e-3))", ["adapt on rank 2", f"{END} on ranks 0, 1"], 3),
    "fields": (
        RUN.format("") + "step = next(run)\nif last: write_fields(step, '.')",
        [END, "write_fields of step 0 on rank"],
        3,
    ),
    "break": (RUN.format("") + "for step in run:\n    if last: break", [STEP, END], 2),
    "exit of rank 0": (RUN.format("") + "for step in run:\n    if comm.rank == 0: sys.exit()", [STEP, END], 3),
    "error": (RUN.format("") + "for step in run:\n    if last: 1 / 0", [STEP, f"{END} by ZeroDivisionError"], 2),
    "interrupt": (RUN.format("") + "next(run)\nif last: raise KeyboardInterrupt\nnext(run)", ["by Keyboard"], 2),
    "no step": (RUN.format("") + "step = next(run)\nwrite_fields(None if last else step, '.')", ["by SceneError"], 2),
    "own call": (RUN.format("") + "if last: 1 / 0\ncomm.Barrier()", ["ZeroDivisionError", "do not answer"], 2),
    "error inside": (INSIDE.format("1 / 0"), ["ZeroDivisionError", f"{STEP} has failed on it alone"], 2),
    "exit inside": (INSIDE.format("sys.exit(0)"), [f"{STEP} has failed on it alone"], 3),
    "interrupt of a wait": (
        HEAD
        + "import signal\nif last: time.sleep(20)\n"
        + "signal.signal(signal.SIGALRM, signal.default_int_handler)\nsignal.setitimer(signal.ITIMER_REAL, 0.5)\n"
        + "solve(patch(), 0.1)",
        ["rank 0 ends all ranks", f"{END} by KeyboardInterrupt, and others do not answer"],
        2,
    ),
    "interrupt inside": (INSIDE.format("raise KeyboardInterrupt"), [f"{END} by KeyboardInterrupt"], 2),
}


@pytest.mark.skipif(COMM.size > 1, reason="starts programs")
@pytest.mark.parametrize("way", ENDS)
def test_program_of_one_rank_ends(tmp_path, way):
    """The others end too, with a sentence, within seconds."""
    program, said, ranks = ENDS[way]
    done = outcome(tmp_path, program, ranks)
    assert done.returncode != 0 and all(words in done.stderr for words in said), done.stderr


@pytest.mark.skipif(COMM.size > 1, reason="starts programs")
def test_exit_before_all(tmp_path):
    """A rank that ends before it has used the package is heard of in a program that the package runs."""
    program = HEAD + "if last: sys.exit(3)\ncomm.Barrier()"
    done = outcome(
        tmp_path, "import fx_contact.parallel.meeting as m; m._GRACE = 1\n" + program, 2, "-m", "fx_contact"
    )
    assert done.returncode != 0 and f"has come to {END} by SystemExit, and others do not answer" in done.stderr


@pytest.mark.skipif(COMM.size > 1, reason="starts programs")
def test_rank_that_works_alone_at_the_end(tmp_path):
    """It is waited for, and the program ends well."""
    program = RUN.format("") + "next(run)\nif comm.rank == 0:\n    time.sleep(2)\n    print('done')"
    done = outcome(tmp_path, program, 2)
    assert (done.returncode, done.stdout, done.stderr) == (0, "done\n", "")


@pytest.mark.skipif(COMM.size > 1, reason="starts programs")
def test_messages_of_the_user_stay_apart(tmp_path):
    """A rank that takes any message of the others gets only theirs, though one of them has come to its end."""
    program = HEAD + "time.sleep(comm.rank - 1 if last else 0)\n"
    program += "comm.send(comm.rank, 0) if comm.rank else print(comm.recv() + comm.recv())"
    done = outcome(tmp_path, program, 3)
    assert (done.returncode, done.stdout, done.stderr) == (0, "3\n", "")


def outcome(folder, program, ranks, *runner):
    """What comes of a program on some ranks."""
    path = folder / "program.py"
    path.write_text(program)
    command = ["mpirun", "-n", str(ranks), sys.executable, *runner, str(path)]
    return subprocess.run(command, capture_output=True, text=True, env=outside(), timeout=30, cwd=folder)


def collective_calls():
    """Public functions and methods whose docstring says Collective: name and source."""
    of_results = {".adaptive.adaptive_loop": ["Run"], ".path.load_path": ["LoadPath"]}
    of_results |= {".adaptive.contact_table": ["ContactTable"]}
    for place in ("", ".scenes", ".results", ".plot", *of_results):
        module = importlib.import_module("fx_contact" + place)
        for name in of_results.get(place, getattr(module, "__all__", ())):
            public = getattr(module, name)
            parts = {name: (public, public.__doc__)} if inspect.isfunction(public) else {}
            for part, value in vars(public).items() if inspect.isclass(public) else ():
                if part == "__init__" or part[0] != "_":
                    parts[f"{name}.{part}"] = value, (public if part == "__init__" else value).__doc__
            for call, (value, doc) in parts.items():
                if "Collective" in (doc or ""):
                    made = [getattr(value, way, None) for way in ("func", "fget", "__func__")]
                    yield call, inspect.getsource(next(filter(None, made), value))


#: What communicates in something else that it asks for, or not at all.
_ELSEWHERE = {"Step.ds", "Run.__init__", "Run.last_step", "LoadPath.__init__"}


def test_all_calls_have_meetings():
    """Every public call that is collective is decorated, or begins a meeting itself."""
    found = dict(collective_calls())
    assert (
        len(found) > 25
        and {"adapt", "Step.stress", "Checkpoint.load", "draw_mesh", "Beginning.uniform"} <= found.keys()
    )
    without = {name for name, text in found.items() if "@collective(" not in text and "with calling(" not in text}
    assert without == _ELSEWHERE


def test_where_the_communicator_is():
    """By position, by name, by default, in attributes; where there is none the function itself says what is wrong."""

    class Holder:
        comm = COMM

    @collective("holder.comm", "f")
    def f(first, holder=Holder):
        return first

    assert [f(1), f(1, Holder), f(first=1, holder=Holder), f(1, holder=None), f(1, 2)] == [1] * 5
    with pytest.raises(TypeError):
        f()
