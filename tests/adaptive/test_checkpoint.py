"""Checkpoints: the same run goes on from them on any number of ranks; whatever is killed, no finished step is lost."""

import json
import os
import random
import resource
import signal
import subprocess
import sys
import time
import zipfile
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from uuid import uuid4

import numpy as np
import pytest
from conftest import WORLD, everywhere, outside
from model_problems import leaves, some, step_record, vertex_positions
from mpi4py import MPI

from fx_contact import Enforcement, ErrorControl, Material, adapt
from fx_contact.adaptive.beginning import Beginning
from fx_contact.adaptive.checkpoint import NAME, Checkpoint
from fx_contact.adaptive.checkpoint_file import CheckpointFile, write_checkpoint
from fx_contact.adaptive.step_record import StepRecord
from fx_contact.fem import nodal_fields
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.forest import forest
from fx_contact.forest.forest import Forest
from fx_contact.parallel import errors
from fx_contact.parallel.errors import CheckpointError, OutputError, SceneError
from fx_contact.results import output
from fx_contact.results.output import RecordWriter
from fx_contact.scenes import hertz
from fx_contact.surfaces.facet_pairing import leaf_code

HERTZ = Path(__file__).parents[2] / "demos" / "hertz.py"


@pytest.fixture(scope="module")
def scene():
    return hertz(order=2, coarse=2)


def summary(step):
    return leaves(step.forest), step.record.force


def by_leaf(forest, *columns):
    """Columns of all ranks' leaves, in an order that does not depend on the ranks."""
    code = np.concatenate(WORLD.allgather(leaf_code(forest.cell, forest.anchor)))
    return [np.concatenate(WORLD.allgather(c))[np.argsort(code)] for c in columns]


@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize("degree", [1, 2])
def test_goes_on_as_if_not_stopped(scene, folder, degree):
    """The steps after a restart have the leaves and the forces, to 1e-7, of a run that nothing stopped."""
    through = [summary(step) for step in adapt(scene, 0.25, degree=degree)]
    assert len(through) >= 3 and len(through[-1][0]) > 2 * len(through[0][0])
    fewer = range(1, WORLD.size)
    for writers, readers in [(WORLD.size, n) for n in fewer] + [(n, WORLD.size) for n in fewer] or [(1, 1)]:
        file, ranks = folder / f"{writers}-{readers}", f"from {writers} to {readers} ranks"
        with some(writers) as comm:
            if comm:
                *_, stopped = adapt(scene, 0.25, comm, degree=degree, max_steps=2, checkpoint=file)
                assert stopped.record.step == 1
        with some(readers) as comm:
            if comm:
                before = Checkpoint(file, scene, comm)
                assert [r.step for r in before.records] == [0, 1] and before.records[0].ranks == writers
                after = [
                    (step.record.step, summary(step))
                    for step in adapt(scene, 0.25, comm, degree=degree, checkpoint=file, restart=before)
                ]
                assert [number for number, _ in after] == list(range(2, len(through))), ranks
                for number, (cells, force) in after:
                    assert np.array_equal(cells, through[number][0]), f"{ranks}: step {number} has other leaves"
                    assert abs(force / through[number][1] - 1) < 1e-7, f"{ranks}: step {number} has another force"
                assert len(Checkpoint(file, scene, comm).records) == len(through)


@pytest.mark.parametrize("degree, steps", [(1, 4), (2, 2)])
def test_holds_what_the_step_had(scene, folder, degree, steps):
    """Leaves, displacements and indicators come back as they were, in another distribution."""
    *_, step = adapt(scene, 0.16, degree=degree, max_steps=steps, checkpoint=folder)
    assert step.record.hanging_nodes > 50 and type(step.record.estimate) is type(step.record.ratio) is float
    values = step.nodal_displacement
    indicator = np.empty(len(step.forest))
    indicator[step.leaf_mesh.leaf] = step.estimate.error

    state = Checkpoint(folder, scene, WORLD).load()
    everywhere(np.array_equal(leaves(step.forest), leaves(state.forest)), "other leaves")
    displacement, error = by_leaf(step.forest, values, indicator)
    again, error_again = by_leaf(state.forest, state.fields["displacement"], state.estimate.error)
    assert np.array_equal(error, error_again) and state.estimate.relative == step.estimate.relative
    assert state.effectivity == step.record.assumed_effectivity
    # Of a hanging vertex ranks have values that differ by rounding.
    assert np.abs(displacement - again).max() <= (WORLD.size > 1) * 1e-15 * np.abs(displacement).max()
    size = (folder / NAME).stat().st_size
    assert size < 17 * step.record.cells + 40 * (step.record.dofs / 3 + step.record.hanging_nodes) + 2**14


def test_fields_go_along(scene, folder):
    """Fields that a run began with, positions here, are after a restart what they are without."""
    forest = Beginning.uniform(scene, 0).forest
    positions = vertex_positions(forest)[forest.vertices.cells]
    beginning = Beginning(forest, np.concatenate([0 * positions, positions], axis=2))
    *_, through = adapt(scene, 0.25, beginning=beginning, max_steps=3)
    list(adapt(scene, 0.25, beginning=beginning, max_steps=2, checkpoint=folder))
    (again,) = adapt(scene, 0.25, restart=Checkpoint(folder, scene, WORLD), max_steps=3)
    (expected,), (found,) = (by_leaf(step.forest, step.carried) for step in (through, again))
    assert expected.shape == (through.record.cells, 27, 3) and np.ptp(expected) > 1
    assert np.abs(found - expected).max() < 1e-14


def test_finished_run(scene, folder):
    """From the last step the same step comes again; with a tighter tolerance the run goes further."""
    list(adapt(scene, 0.5, checkpoint=folder))
    before = Checkpoint(folder, scene, WORLD)
    (again,) = adapt(scene, 0.5, checkpoint=folder, restart=before)
    assert again.record.step == before.records[-1].step
    assert abs(again.record.force / before.records[-1].force - 1) < 1e-7
    assert len(Checkpoint(folder, scene, WORLD).records) == len(before.records)
    *_, further = adapt(scene, 0.1, restart=before)
    assert further.record.step > again.record.step and further.record.ratio <= 1


@pytest.mark.parametrize("steps, assumed", [(1, 0.4), (2, 0.7)])
def test_the_last_step_again(scene, folder, steps, assumed):
    """A solve on the mesh that a run has ended with is of a first mesh if that was one."""
    *_, last = adapt(scene, 0.16, degree=1, max_steps=steps, checkpoint=folder)
    (again,) = adapt(scene, 0.16, degree=1, max_steps=steps, restart=Checkpoint(folder, scene, WORLD))
    assert again.record.step == last.record.step == steps - 1
    assert again.record.assumed_effectivity == last.record.assumed_effectivity == assumed
    assert again.record.expected_estimate == last.record.expected_estimate


# ------------------------------------------------------------------------------------------- what is wrong with a file


def caught(kind, action):
    """The message of an error that all ranks raise alike."""
    with pytest.raises(errors.FxContactError) as error:
        action()
    told = set(WORLD.allgather((error.type.__name__, str(error.value))))
    assert told == {(kind.__name__, str(error.value))}
    return str(error.value)


def alone(action):
    """Run on rank 0, the others wait."""
    if WORLD.rank == 0:
        action()
    WORLD.Barrier()


def test_arrays_come_back(folder):
    """In the order of the ranks, dealt out evenly, on fewer ranks too; the file is an archive that NumPy reads."""
    path, mine = folder / "file", np.arange(1000 * WORLD.rank, 1000 * WORLD.rank + 7 + 5 * WORLD.rank)
    content = {"text": "é", "list": [1, None]}
    write_checkpoint(path, WORLD, content, {"numbers": mine, "thirds": np.stack([mine, mine**2], 1) / 3})
    expected = np.concatenate([np.arange(1000 * r, 1000 * r + 7 + 5 * r) for r in range(WORLD.size)])
    for readers in {1, WORLD.size - 1, WORLD.size} - {0}:
        with some(readers) as comm:
            if comm:
                file = CheckpointFile(path, comm)
                numbers, thirds = file.array("numbers"), file.array("thirds")
                assert file.content == content and numbers.dtype == np.int64
                assert np.array_equal(np.concatenate(comm.allgather(numbers)), expected)
                assert np.array_equal(thirds, np.column_stack([numbers, numbers**2]) / 3)
                assert np.ptp(comm.allgather(len(numbers))) <= 1
    with np.load(path) as archive:
        assert np.array_equal(archive["numbers/0"], np.arange(7))


def test_every_byte_counts(folder):
    """A file that ends early, or one of whose bytes is changed, is refused or read as it was written."""
    path = folder / "file"
    arrays = {"numbers": np.random.default_rng(WORLD.rank).random((40, 3)), "empty": np.zeros((0, 2))}
    write_checkpoint(path, WORLD, ["content"], arrays)

    def read():
        file = CheckpointFile(path, WORLD)
        return file.content, {name: file.array(name) for name in arrays}

    def alike():
        content, back = read()
        return content == ["content"] and all(np.array_equal(back[name], array) for name, array in arrays.items())

    assert alike()
    good = WORLD.bcast(path.read_bytes() if WORLD.rank == 0 else None)
    chosen = np.random.default_rng(1).choice(len(good), 300, replace=False).tolist()
    bad = [good[:at] + bytes([good[at] ^ 1 << at % 8]) + good[at + 1 :] for at in chosen]
    refused = 0
    for data in bad:
        alone(lambda: path.write_bytes(data))
        try:
            assert alike(), "other data"
        except CheckpointError:
            refused += 1
    assert refused > 200
    for data in (*(good[:at] for at in (0, 5, 32, 100, len(good) // 2, len(good) - 1)), good[::-1]):
        alone(lambda: path.write_bytes(data))
        assert "file" in caught(CheckpointError, read)


def of_version_8(path):
    """The content says that another release has written it."""
    with zipfile.ZipFile(path) as archive:
        about = json.loads(archive.read("content.json"))
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("content.json", json.dumps(about | {"version": 8}))


def without_forces(path):
    """Records lack an entry."""
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    about = json.loads(parts["content.json"])
    for record in about["content"]["records"]:
        del record["force"]
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in (parts | {"content.json": json.dumps(about)}).items():
            archive.writestr(name, data)


@pytest.mark.parametrize(
    "spoil, words",
    [
        (lambda path: path.unlink(), "No such file"),
        (lambda path: (path.unlink(), path.mkdir()), "is no file"),
        (lambda path: (path.unlink(), os.mkfifo(path)), "is no file"),
        (lambda path: path.write_bytes(b""), "not complete"),
        (lambda path: path.write_bytes(path.read_bytes()[:-8]), "not complete"),
        (lambda path: path.write_text("step cells\n" * 99), "no checkpoint of this program"),
        (lambda path: path.write_bytes(b"fx-rows\n" + bytes(99)), "another release"),
        (lambda path: path.write_bytes(path.read_bytes().replace(b'"version": 11', b'"version": 19')), "damaged"),
        (of_version_8, "another release"),
        (without_forces, "of another version of fx_contact: begin anew"),
    ],
)
def test_damaged(scene, folder, spoil, words):
    """What is wrong with a checkpoint is said on all ranks."""
    next(adapt(scene, 0.25, checkpoint=folder))
    alone(lambda: spoil(folder / NAME))
    assert words in caught(
        CheckpointError, lambda: list(adapt(scene, 0.25, restart=Checkpoint(folder, scene, WORLD)))
    )


@pytest.mark.parametrize("make", [Path.mkdir, os.mkfifo, lambda path: path.write_text("mine")])
def test_what_is_no_checkpoint_stays(scene, folder, make):
    """What is called like a checkpoint, but is none, is neither replaced nor called one, and nobody waits for it."""
    alone(lambda: make(folder / NAME))

    def kept():
        """Which file it is, and when it was written; when it was read may change."""
        stat = (folder / NAME).stat()
        return stat.st_ino, stat.st_mode, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns

    before = kept()
    assert "is no" in caught(CheckpointError, lambda: adapt(scene, 0.25, checkpoint=folder))
    assert kept() == before


def test_belongs_to_another_problem(scene, folder):
    """What differs is named."""
    next(adapt(scene, 0.25, checkpoint=folder))
    soft = {name: Material(0.5, 0.3) for name in scene.materials}
    for changed, words in (
        (replace(scene, materials=soft), "materials ({"),
        (
            replace(scene, contact_centre=(0.0, 0.0, 0.1)),
            "symmetry ([4, 0.0, 0.0, 0.0] then, [4, 0.0, 0.0, 0.1] now)",
        ),
        (hertz(order=2, coarse=3), "root mesh"),
    ):
        message = caught(CheckpointError, lambda: Checkpoint(folder, changed, WORLD))
        assert "another problem" in message and words in message
    before = Checkpoint(folder, replace(scene, name="other"), WORLD)
    for options, words in (
        ({"enforcement": Enforcement("penalty")}, "enforcement ({"),
        ({"geometry_order": 1}, "geometry order (null then, 1 now)"),
        ({"degree": 1}, "degree (2 then, 1 now)"),
        ({"control": ErrorControl(target=0.8)}, "problem: error control's target (0.9 then, 0.8 now); continue"),
    ):
        assert words in caught(CheckpointError, lambda: next(adapt(scene, 0.25, restart=before, **options)))
    assert "got True" in caught(SceneError, lambda: next(adapt(scene, 0.25, restart=True)))
    begin = Beginning.uniform(scene, 1)
    assert "not both" in caught(SceneError, lambda: next(adapt(scene, 0.25, restart=before, beginning=begin)))


# -------------------------------------------------------------------------------------------------- nothing is lost


def test_two_runs_at_once(scene, folder):
    """Of two runs that begin in one folder, or go on from one checkpoint, the first to finish a step has it."""
    assert "cannot write" in caught(OutputError, lambda: next(adapt(scene, 0.25, checkpoint="/dev/null/run")))
    for restart in (None, Checkpoint):
        before = restart and restart(folder, scene, WORLD)
        one, other = (adapt(scene, 0.16, degree=1, checkpoint=folder, restart=before) for _ in range(2))
        next(one)
        WORLD.Barrier()
        kept = (folder / NAME).read_bytes()
        with pytest.raises(OutputError, match="of another run and would be replaced") as late:
            next(other)
        assert (folder / NAME).read_bytes() == kept and not any(folder.glob(NAME + ".new*"))
        holds_last_state(late.value, len(Checkpoint(folder, scene, WORLD).records) - 1)
        with pytest.raises(OutputError, match="would be replaced"):
            adapt(scene, 0.16, degree=1, checkpoint=folder, restart=before)
        next(one)


def holds_last_state(error, number):
    """An error in the middle of a run has the last step's record, and a displacement that belongs to a forest."""
    assert error.record.step == number
    held = Prolongation(Space(error.forest, error.record.degree))
    everywhere(error.displacement.shape == (held.owned, 3), "a displacement of another forest")
    everywhere(WORLD.allreduce(np.abs(error.displacement).max(initial=0.0), MPI.MAX) > 0, "no displacement")


def test_disk_full_in_a_run(scene, folder):
    """The error says so, and has the step that could not be kept; the one before is kept, and nothing else is there."""
    run = adapt(scene, 0.25, checkpoint=folder)
    next(run)
    with file_size(1000), pytest.raises(OutputError, match="checkpoint': File too large; make room") as full:
        next(run)
    holds_last_state(full.value, 1)
    everywhere([path.name for path in folder.iterdir()] == [NAME], "half a file is left")
    assert len(Checkpoint(folder, scene, WORLD).records) == 1


@pytest.mark.parametrize(
    "place, name, error",
    [(Forest, "refined_with", errors.GeometryError), (nodal_fields, "repartition", errors.PartitionError)],
)
def test_error_between_steps(scene, monkeypatch, place, name, error):
    """What fails between steps holds the last one."""

    def fails(*_):
        raise error("on purpose")

    run = adapt(scene, 0.25)
    next(run)
    monkeypatch.setattr(place, name, fails)
    with pytest.raises(error, match="on purpose") as caught:
        next(run)
    holds_last_state(caught.value, 0)


def test_finest_level(scene, monkeypatch):
    """A run that would have to refine the finest leaves ends with an error that holds the last step."""
    monkeypatch.setattr(forest, "MAX_LEVEL", 2)
    with pytest.raises(errors.GeometryError, match="leaves of the finest level, 2, are marked") as caught:
        list(adapt(scene, 0.01))
    holds_last_state(caught.value, caught.value.record.step)


@contextmanager
def file_size(limit):
    """On the last rank no file may be longer than a limit."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    if WORLD.rank == WORLD.size - 1:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def test_disk_full_on_one_rank(folder):
    """Where one rank cannot write, all raise, and the file before is still there; what killed runs leave is removed."""
    rows = np.arange(4000.0).reshape(-1, 1) + WORLD.rank
    write_checkpoint(folder / "file", WORLD, "old", {"rows": rows})
    with file_size(WORLD.rank * 32000 + 1000):
        message = caught(OutputError, lambda: write_checkpoint(folder / "file", WORLD, "new", {"rows": rows + 1}))
    assert "make room" in message
    everywhere([path.name for path in folder.iterdir()] == ["file"], "half a file is left")
    file = CheckpointFile(folder / "file", WORLD)
    assert file.content == "old" and np.concatenate(WORLD.allgather(file.array("rows")))[-1] == 3999 + WORLD.size - 1
    left = f"file.new-{WORLD.bcast(uuid4().hex)}"
    theirs = {"file.new", "file.new-2", f"{left}.txt", f"my {left}"}
    for name in theirs | {left}:
        alone(lambda: (folder / name).write_bytes(b"garbage" * 999))
    write_checkpoint(folder / "file", WORLD, "newest", {"rows": rows})
    assert CheckpointFile(folder / "file", WORLD).content == "newest"
    everywhere({path.name for path in folder.iterdir()} == theirs | {"file"}, "other files than users put there")


@pytest.mark.parametrize("make", [Path.mkdir, os.mkfifo])
def test_records_need_a_file(folder, make):
    """Nobody waits for what reads a pipe."""
    alone(lambda: make(folder / "steps.jsonl"))
    assert "is no file" in caught(OutputError, lambda: RecordWriter(folder, WORLD))


@pytest.mark.parametrize(
    "there, expected",
    [
        (None, "0 1 2 3"),
        ("", "0 1 2 3"),
        ('{"st', "0 1 2 3"),
        ('{"step": 0, "kept": 1}\n{"step": 1}\n', "0+ 1 2 3"),
        ('{"step": 0}\n{"step": 1}\n{"step": 2, "kept": 1}\n{"step": 3, "fo', "0 1 2+ 3"),
        ('{"step": 0}\n{"step": 1}\n{"step": 2}', "0 1 2 3"),
    ],
)
def test_records_go_on(folder, there, expected, monkeypatch):
    """Finished lines stay as they are, half of a last one goes, missing ones are added."""
    monkeypatch.setattr(output, "_TELLING", ())
    path = folder / "steps.jsonl"
    if there is not None:
        alone(lambda: path.write_text(there))
    writer = RecordWriter(folder, WORLD, [step_record(number) for number in range(3)])
    writer.write(step_record(3, scene="draft" * 99))
    writer.write(step_record(3))
    WORLD.Barrier()
    found = []
    for line in path.read_text().splitlines():
        record = json.loads(line)
        found.append(f"{record['step']}{'+' * ('kept' in record)}")
        assert "draft" not in line
    assert " ".join(found) == expected


@pytest.mark.parametrize(
    "there, words",
    [
        ([step_record(0, force=1.0, seconds=3), step_record(1, force=3.0)], "line 2 of"),
        ([{"step": 0}], "line 1 of"),
        ([step_record(0, force=1.0), step_record(2, force=2.5), 5], "line 2 of"),
    ],
)
def test_records_of_another_run(folder, there, words):
    """Records of another run are no beginning of this one: they stay to the last byte; an empty folder gets its own."""
    path = folder / "steps.jsonl"
    there = "\n".join(json.dumps(r.as_json() if isinstance(r, StepRecord) else r) for r in there) + "\n"
    alone(lambda: path.write_text(there))
    finished = [step_record(0, force=1.0, seconds=1), step_record(1, force=2.0, seconds=2)]
    assert words in caught(OutputError, lambda: RecordWriter(folder, WORLD, finished))
    assert path.read_text() == there
    RecordWriter(folder / "new", WORLD, finished)
    WORLD.Barrier()
    lines = (folder / "new" / "steps.jsonl").read_text().splitlines()
    assert [StepRecord.from_json(json.loads(line)) for line in lines] == finished
    # The last step may have been solved for again, on another number of ranks.
    again = [finished[0], replace(finished[1], force=2.0 * (1 + 1e-8), ranks=5, krylov_iterations=[7])]
    RecordWriter(folder / "new", WORLD, again)


class Life:
    """A run of `demos/hertz.py` in a session of its own, to be killed."""

    SETTINGS = "--order 2 --coarse 2 --tolerance 0.25 --records-only"

    def __init__(self, folder, ranks):
        self.checkpoint, self.records = folder / "kept" / NAME, folder / "steps.jsonl"
        command = f"mpirun -n {ranks} {sys.executable} {HERTZ} {self.SETTINGS} --output {folder}"
        command += f" --checkpoint {folder / 'kept'}" + " --restart" * self.checkpoint.exists()
        self.log = (folder / "log").open("a")
        self.process = subprocess.Popen(
            command.split(), stdout=self.log, stderr=self.log, env=outside(), start_new_session=True
        )

    def end(self, patience=120):
        """Wait for the end; the exit code."""
        return self.process.wait(patience)

    def until(self, moment):
        """Whether the run still lives when a moment has come: seconds, or None for the writing of a checkpoint."""
        start, folder, pattern = time.monotonic(), self.checkpoint.parent, NAME + ".new*"
        while not (any(folder.glob(pattern)) if moment is None else time.monotonic() > start + moment):
            if self.process.poll() is not None:
                return False
            time.sleep(2e-4)
        return self.process.poll() is None

    def members(self):
        """Process numbers of the session, and of its ranks."""
        members, ranks = [], []
        for entry in Path("/proc").iterdir():
            if entry.name.isdigit():
                try:
                    name, rest = (entry / "stat").read_text().rsplit(")", 1)
                except OSError:
                    continue
                state, _, _, session = rest.split()[:4]
                if int(session) == self.process.pid and state != "Z":
                    members.append(int(entry.name))
                    ranks += [int(entry.name)] if "(python" in name else []
        return members, ranks

    def kill(self, one, rng):
        """Kill one rank, or all and mpirun, and see that nothing of the run is left."""
        members, ranks = self.members()
        for victim in [rng.choice(sorted(ranks))] if one and ranks else members:
            _kill(victim)
        try:
            self.process.wait(30)
        except subprocess.TimeoutExpired:
            pass
        while members := self.members()[0]:
            for victim in members:
                _kill(victim)
            time.sleep(0.01)
        self.process.wait()


def _kill(pid):
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        pass


def complete_lines(path):
    text = path.read_text() if path.exists() else ""
    return text[: text.rfind("\n") + 1].splitlines()


@pytest.mark.skipif(WORLD.size > 1, reason="starts runs of its own, on 1, 2 and 3 ranks")
def test_killed_at_random_moments(tmp_path, request):
    """kill -9 of one rank or of all, restarts on 1 to 3 ranks: no finished step is lost, and the end is the same."""
    rng, kills, wanted, lives = random.Random(7), 0, request.config.getoption("--kills"), 0
    (tmp_path / "whole").mkdir()
    start = time.monotonic()
    whole = Life(tmp_path / "whole", 2)
    assert whole.end() == 0, (tmp_path / "whole" / "log").read_text()
    duration = time.monotonic() - start
    expected = [StepRecord.from_json(json.loads(line)) for line in complete_lines(whole.records)]
    while kills < wanted:
        folder, done, kept = tmp_path / f"run-{lives}", [], 0
        folder.mkdir()
        lives += 1
        while True:
            life = Life(folder, rng.randint(1, 3))
            killed = kills < wanted and life.until(None if rng.random() < 1 / 3 else rng.uniform(0.1, duration))
            if not killed:
                break
            life.kill(rng.random() < 0.5, rng)
            kills += 1
            lines = complete_lines(life.records)
            assert lines[: len(done)] == done, "a finished line was lost"
            if life.checkpoint.exists():
                steps = CheckpointFile(life.checkpoint, MPI.COMM_SELF).content["records"]
                assert len(steps) >= max(len(lines), kept), "the checkpoint lost a finished step"
                kept = len(steps)
            else:
                assert not lines, "a step was recorded, but not kept"
            done = lines
        assert life.end() == 0, (folder / "log").read_text()
        lines = complete_lines(life.records)
        assert lines[: len(done)] == done, "a finished line was lost"
        records = [StepRecord.from_json(json.loads(line)) for line in lines]
        assert [r.step for r in records] == list(range(len(expected)))
        for one, other in zip(records, expected):
            assert one.cells == other.cells and one.active_pairs == other.active_pairs
            assert abs(one.force / other.force - 1) < 1e-7
