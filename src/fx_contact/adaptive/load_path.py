"""Load paths: scenes that depend on a number, each solved from where the one before has ended."""

import time
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fx_contact.adaptive.adaptive_loop import adapt
from fx_contact.adaptive.carry_over import carried_over
from fx_contact.adaptive.checkpoint import NAME, Checkpoint, CheckpointWriter, State
from fx_contact.adaptive.row_file import RowFile
from fx_contact.adaptive.step import Step
from fx_contact.adaptive.sweep_record import SweepRecord, write_sweep
from fx_contact.parallel.agreement import check_alike
from fx_contact.parallel.errors import CheckpointError, PartitionError, SceneError
from fx_contact.parallel.meeting import calling, collective
from fx_contact.parallel.mpi import together
from fx_contact.parallel.validation import as_path, check_comm, check_number, shown
from fx_contact.problem.fingerprint import mesh_digest
from fx_contact.problem.scene import check_scene

#: How a point begins (`SweepRecord.begun`).
ANEW, KEPT, COARSE = "anew", "kept", "coarse"


@collective("comm")
def sweep(scene_of, values, tolerance, comm=MPI.COMM_WORLD, *, folder=None, restart=False, **options):
    """Solve scenes that depend on a number (approach, force, modulus), each to a prescribed accuracy.

    Collective on comm; so is every point of the iteration.  A point begins with the forest and the displacement of the
    one before (`carry_over`).  The forest is kept, but for leaves finer than needed, as long as one solve on it reaches
    the tolerance; from the first point on where it does not, points begin on a coarse forest.  With a kept forest goes
    the measured effectivity theta of the estimator.  That is sound while neither Poisson's ratios (locking) nor the set
    of closed contact pairs (what is bent or sheared) change; where they do the forest is coarse, and theta is measured.
    Where the root mesh or the contact pairs of the scene change, a point is begun anew.

    Contact without friction has no history: the points may be solved in any order.

    Args:
        scene_of: function of a value that gives the Scene; called collectively, in turn.
        values: of the parameter, numbers.
        tolerance: prescribed relative error e in the energy norm of each point, (6) [-].
        comm: MPI communicator.
        folder: for `sweep.jsonl`, `sweep.csv` and the checkpoint of the last point; None: nothing is written.
        restart: whether to go on after the last point in that folder; `values` may be more than then.
        options: of `adapt`, for each point; a `beginning` is for points that are begun anew.

    Returns:
        Sweep, an iterator of SweepPoint.

    Raises:
        SceneError: values are no finite numbers, arguments differ between ranks, or as `adapt`.
        CheckpointError: there is nothing to restart from, or it is of other values, another problem or other options.
        OutputError: the folder cannot be written, or has the checkpoint of another run.
        FxContactError: as `adapt`, while a point is solved.
    """
    check_comm(comm)
    with together(comm):
        if not callable(scene_of):
            raise SceneError(f"scene_of must be a function of a value that gives a Scene, got {shown(scene_of)}")
        values = _checked(values)
        for name in ("checkpoint", "restart"):
            if name in options:
                raise SceneError(f"a sweep takes no {name!r} of adapt: it keeps its last point in its own folder")
        if folder is not None:
            folder = as_path("the folder of a sweep", folder)
        elif restart:
            raise SceneError("a sweep restarts from the folder of one before: name it")
    check_alike(comm, {"values": values, "folder of a sweep": folder and str(folder), "restart": bool(restart)})
    return Sweep(scene_of, values, tolerance, comm, folder, restart, options)


def _checked(values):
    """Values as a list of float.  Raises SceneError unless they are finite numbers, one at least."""
    try:
        values = list(values)
    except TypeError:
        raise SceneError(f"the values of a sweep must be a list of numbers, got {shown(values)}") from None
    if not values:
        raise SceneError("the values of a sweep must be one number at least, got none")
    return [check_number("a value of a sweep", value) for value in values]


@dataclass(frozen=True, eq=False)
class SweepPoint:
    """A solved point of a load path.

    Attributes:
        value: of the parameter.
        step: Step, the last one.
        record: SweepRecord.
    """

    value: float
    step: Step
    record: SweepRecord


class Sweep:
    """A load path: an iterator of its points.

    Collective on comm.  `sweep` makes it.

    Args:
        scene_of, values, tolerance, comm, folder, restart, options: as `sweep` has them, checked.

    Attributes:
        records: list of SweepRecord, of all points so far, with those before a restart.
    """

    def __init__(self, scene_of, values, tolerance, comm, folder, restart, options):
        self.records = []
        self._scene_of, self._values, self._tolerance, self._comm = scene_of, values, tolerance, comm
        self._folder, self._options, self._writer = folder, options, None
        self._before, self._last = None, None  # a Checkpoint to restart from; State and Scene of the last point
        self._settings = None  # of the last run
        if restart:
            self._resume()

    def __iter__(self):
        return self

    def __next__(self):
        if len(self.records) >= len(self._values):
            raise StopIteration
        with calling(self._comm, "the next point of sweep"):
            return self._point()

    def _point(self):
        """Solve the next SweepPoint.  Collective."""
        value = self._values[len(self.records)]
        scene = self._scene_of(value)
        with together(self._comm):
            check_scene(scene)
        start = time.process_time()
        run, begun, solves = self._solved(scene)
        compiled = sum(one.cpu_seconds["compile"] for one in solves)
        record = SweepRecord(
            point=len(self.records),
            value=value,
            begun=begun,
            solves=len(solves),
            unknowns=sum(one.dofs for one in solves),
            cpu_seconds=self._comm.allreduce(time.process_time() - start) - compiled,
            record=run.step.record,
        )
        self.records.append(record)
        self._last = (State.of(run.step), scene)
        if self._folder is not None:
            self._keep(run)
        return SweepPoint(value, run.step, record)

    def _solved(self, scene):
        """The finished Run of a scene, how it has begun, and the StepRecords of all solves.  Collective."""
        given_up = []
        for way in self._ways(scene):
            try:
                run = self._begun(scene, way)
            except PartitionError:  # the merged forest has too few leaves for the ranks
                if way == ANEW:
                    raise
                continue
            if way != KEPT or (run.step.record.reached and self._closed_alike(run.step.record)):
                break
            given_up += run.records
        while run.advance():
            pass
        return run, way, given_up + run.records

    def _ways(self, scene):
        """How the point of a scene may begin, the best first.  Local."""
        if self._last is None or not _same_root(self._last[0].forest, scene):
            return [ANEW]
        record, before = self.records[-1], self._last[1]
        alike = [m.poisson for m in scene.materials.values()] == [m.poisson for m in before.materials.values()]
        return [KEPT, COARSE, ANEW] if alike and record.begun != COARSE else [COARSE, ANEW]

    def _begun(self, scene, way):
        """A Run of a scene after its first step.  Collective."""
        options = dict(self._options)
        if way != ANEW:
            asked, kind = self._settings, options.get("partition_kind", "contact-sfc")
            coarse = way == COARSE
            options["beginning"] = carried_over(self._last[0], asked.tolerance, asked.control, kind, coarse)
        run = adapt(scene, self._tolerance, self._comm, **options)
        self._settings = run.settings
        if self._folder is not None and self._writer is None:
            about = run.settings.problem, run.settings.kept(), self._before
            self._writer = CheckpointWriter(self._folder, self._comm, *about)
        run.advance()
        return run

    def _closed_alike(self, record):
        """Whether the same contact pairs are closed as in the last point.  Local."""
        return np.array_equal(np.array(record.pair_forces) > 0, np.array(self.records[-1].record.pair_forces) > 0)

    def _keep(self, run):
        """Write the points so far, and the state from which a restart goes on.  Collective."""
        points = [record.as_json() for record in self.records]
        self._writer.save(run.step, [run.step.record], {"problem": run.settings.problem, "points": points})
        write_sweep(self._folder, self._comm, self.records)

    def _resume(self):
        """Take up the last point in the folder.  Collective."""
        path, comm = self._folder / NAME, self._comm
        points = RowFile(path, comm).content.get("points")
        with together(comm):
            if points is None:
                raise CheckpointError(f"{str(path)!r} is of a single run, not of a sweep: name another folder")
            self.records = [SweepRecord.from_json(entries) for entries in points]
            before = [record.value for record in self.records]
            if before != self._values[: len(before)]:
                raise CheckpointError(
                    f"{str(path)!r} belongs to a sweep over {shown(before)}, and the values now begin with "
                    f"{shown(self._values[: len(before)])}: give the same, and more if you like"
                )
        scene = self._scene_of(before[-1])
        self._before = Checkpoint(self._folder, scene, comm)
        self._settings = adapt(scene, self._tolerance, comm, **self._options).settings
        with together(comm):
            self._before.check(self._settings.problem, self._settings.kept())
        self._last = (self._before.load(), scene)
        write_sweep(self._folder, comm, self.records)


def _same_root(forest, scene):
    """Whether a forest is on the root mesh of a scene, with its contact pairs.  Local."""
    same = forest.mesh is scene.mesh or mesh_digest(forest.mesh) == mesh_digest(scene.mesh)
    return same and forest.stands_on(scene.pairing, scene.contact_surfaces)
