"""The adaptive loop: solve, estimate, mark, refine, repartition; a record and the solution a step."""

from dataclasses import replace

import numpy as np
from mpi4py import MPI

from fx_contact.adaptive.beginning import Beginning
from fx_contact.adaptive.checkpoint import Checkpoint, CheckpointWriter
from fx_contact.adaptive.settings import DEGREE, Settings
from fx_contact.adaptive.step_solver import StepStart, solve_step
from fx_contact.adaptive.validity import check_model_warnings, load_warnings
from fx_contact.contact.enforcement import Enforcement
from fx_contact.contact.row_kinds import needed_keys
from fx_contact.estimate.error_control import ErrorControl
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.forest.forest import Forest
from fx_contact.forest.partition import KINDS, repartition
from fx_contact.forest.partition_quality import PartitionSummary
from fx_contact.linalg.solver_options import Solver
from fx_contact.parallel.agreement import check_alike
from fx_contact.parallel.errors import FxContactError, PartitionError, SceneError, SolveError
from fx_contact.parallel.meeting import calling, collective
from fx_contact.parallel.memory import give_back
from fx_contact.parallel.mpi import together
from fx_contact.parallel.timing import Stages
from fx_contact.parallel.validation import check_comm, check_count, check_name, check_same_comm, percent, shown


@collective("comm")
def adapt(
    scene,
    tolerance,
    comm=MPI.COMM_WORLD,
    *,
    degree=DEGREE,
    max_steps=20,
    geometry_order=None,
    enforcement=None,
    solver=None,
    control=None,
    goals=(),
    partition_kind="contact-sfc",
    allow=(),
    beginning=None,
    checkpoint=None,
    restart=None,
    progress=None,
):
    """Solve a scene to a prescribed accuracy, refining where the error is.

    Collective on comm; so is every step of the iteration.  Where only the last step counts, `solve` takes less memory.

    Args:
        scene: Scene.  It and all that follows must be the same on all ranks, but for progress.
        tolerance: prescribed relative error e in the energy norm, (6) [-].
        comm: MPI communicator.
        degree: p of the displacements, 1 or 2.
        max_steps: most solves, with those before a restart.
        geometry_order: order of the leaf maps; None: the lowest that holds the root map to
            `settings.GEOMETRY_SHARE` times the tolerance.
        enforcement: Enforcement of the contact conditions; None: the default one.
        solver: Solver; None: the default one.
        control: ErrorControl, what is refined for and when to stop; None: the default one.
        goals: quantities that are held to tolerances of their own, besides: ContactForce, Gap, MaxPressure,
            Displacement, Reaction.
        partition_kind: a key of `partition.KINDS`.
        allow: doubts of the record that are errors unless they are named here, keys of `validity.REFUSED`:
            "large strain", "large rotation", "no load".
        beginning: Beginning; None: the root cells.
        checkpoint: folder in which every step is kept before it is yielded, in the place of the one before; None: not.
        restart: Checkpoint to go on from: with the next step, or with the same one again if that was the last.
        progress: function of a step's number and the name of one of its `timing.STAGES`, called on every rank whenever
            work on that stage begins; it must not raise.  None: nobody is told.

    Returns:
        Run, an iterator of Step, until xi / (e omega) <= 1 (6), or max_steps are done.  By default xi is corrected by
        the measured effectivity, for which two meshes are needed at least, and contact is resolved (`ErrorControl`).

    Raises:
        SceneError: a tolerance that is not positive, another degree, an order above that of the root mesh, an unknown
            partition or kind of doubts, a progress that is no function, a beginning of another scene, arguments that
            differ between ranks.
        PartitionError: a rank would get no leaf.
        GeometryError: leaves of the finest level are to be refined.
        CheckpointError: the checkpoint is damaged, or of a run with another scene, degree, enforcement or geometry
            order.
        OutputError: a checkpoint cannot be written, or would replace that of another run.
        CompilationError: there is no C compiler, or no folder for what it makes.
        ValidityError: nothing loads the scene, or strains or rotations are far from small (`validity`).
        SolveError: a solve fails, or would not fit into the memory; a penalty is too soft for the tolerance.
        What was yielded before stays valid; an `FxContactError` holds the last state.
    """
    check_comm(comm)
    with together(comm):
        enforcement = Enforcement() if enforcement is None else enforcement
        solver = Solver() if solver is None else solver
        control = ErrorControl() if control is None else control
        parts = dict(enforcement=enforcement, solver=solver, control=control, goals=goals, allow=allow)
        settings = Settings(scene, tolerance, geometry_order=geometry_order, degree=degree, **parts)
        check_count("max_steps", max_steps)
        check_name("partition", partition_kind, KINDS)
        if progress is not None and not callable(progress):
            raise SceneError(
                f"progress must be a function of a step's number and a stage's name, got {shown(progress)}"
            )
        _check_start(settings, comm, beginning, restart)
        asked = settings.asked() | {
            "most steps": max_steps,
            "partition": partition_kind,
            "fields that a beginning carries": None if beginning is None else beginning.values.shape[2],
            "checkpoint": None if checkpoint is None else str(checkpoint),
            "restart": None if restart is None else [str(restart.path), len(restart.records)],
        }
    check_alike(comm, asked)
    writer = None
    if checkpoint is not None:
        writer = CheckpointWriter(checkpoint, comm, settings.problem, settings.kept(), restart)
    return Run(
        settings,
        comm,
        max_steps=max_steps,
        partition_kind=partition_kind,
        source=restart or beginning,
        writer=writer,
        progress=progress,
    )


def _check_start(settings, comm, beginning, restart):
    """See that a run can begin where it is told to, and that something loads the scene.  Local."""
    check_model_warnings(load_warnings(settings.scene), settings.allow)
    for name, value, kind in (("restart", restart, Checkpoint), ("beginning", beginning, Beginning)):
        if value is not None and not isinstance(value, kind):
            raise SceneError(f"{name} must be a {kind.__name__}, got {shown(value)}")
    if beginning is not None and restart is not None:
        raise SceneError("a run begins at a Beginning or restarts from a Checkpoint, not both")
    if restart is not None:
        check_same_comm("the checkpoint to restart from", restart.comm, comm)
        restart.check(settings.problem, settings.kept())
    if beginning is not None:
        beginning.check(settings.scene, comm)


@collective("comm")
def solve(scene, tolerance, comm=MPI.COMM_WORLD, **options):
    """Solve a scene to a prescribed accuracy; no step but the last is kept.

    Collective on comm.

    Args:
        scene, tolerance, comm, options: as `adapt` has them.

    Returns:
        Step, the last one; `step.record.reached` tells whether the tolerance is reached.

    Raises:
        FxContactError: as `adapt`.
    """
    run = adapt(scene, tolerance, comm, **options)
    while run.advance():
        pass
    return run.step


class Run:
    """A run of the adaptive loop: an iterator of its steps, and what it goes on with from one to the next.

    Collective on comm.  `adapt` makes it.

    Args:
        settings: Settings.
        comm: MPI communicator.
        max_steps: most solves, with those before a restart.
        partition_kind: a key of `partition.KINDS`.
        source: Beginning, Checkpoint to restart from, or None for the root cells.
        writer: CheckpointWriter or None.
        progress: as `adapt` has it.

    Attributes:
        step: Step that was solved last; None before the first, and while the next is being solved.
        records: list of StepRecord, of all steps so far.
    """

    def __init__(self, settings, comm, *, max_steps, partition_kind, source, writer, progress):
        self.step, self.records = None, []
        self._settings, self._comm, self._kind = settings, comm, partition_kind
        self._max_steps, self._source, self._writer, self._progress = max_steps, source, writer, progress
        self._forest = self._values = None
        self._history, self._finished = settings.control.begin(), False
        self._last = {"record": None, "forest": None, "displacement": None}  # for errors: `FxContactError`

    def __iter__(self):
        return self

    @property
    def settings(self):
        """Settings of the run."""
        return self._settings

    def __next__(self):
        if not self.advance():
            raise StopIteration
        return self.step

    def advance(self):
        """Solve the next step.

        Collective.

        Returns:
            bool, whether there was one to solve.

        Raises:
            FxContactError: as `adapt`; then the run is over.
        """
        if self._finished:
            return False
        with calling(self._comm, "the next step of adapt"):
            self._finished = True  # unless this ends well
            try:
                if self._forest is None:
                    stages = self._begin()
                else:
                    stages = self._refine()
                self._solve(stages)
            except FxContactError as error:
                vars(error).update(self._last)
                raise
        record = self.step.record
        self._finished = record.reached or record.step >= self._max_steps - 1
        return True

    def _begin(self):
        """Forest, values, records and history of the source: Stages of the first step."""
        source, self._source = self._source, None
        restarts = isinstance(source, Checkpoint)
        stages = self._stages(len(source.records) if restarts else 0)
        if restarts:
            with stages("refine"):
                self._resume(source)
        elif source is not None:
            self._forest, self._values = source.forest, source.of_degree(self._settings.degree)
            self._history = source.history or self._history
        else:
            with stages("partition"):
                self._forest = _first_forest(self._settings.scene, self._comm, self._kind)
        return stages

    def _resume(self, checkpoint):
        """Go on where a run has ended: with its next step, or with its last one again if there is none."""
        state, settings = checkpoint.load(), self._settings
        self.records, self._last["record"] = list(checkpoint.records), checkpoint.records[-1]
        control, progress = settings.control, (state.estimate, settings.tolerance, state.history)
        more = self._comm.allreduce(bool(state.refine.any()), op=MPI.LOR)
        if (control.sought(*progress) is None and not more) or len(self.records) >= self._max_steps:
            self._forest, self._values = state.forest, state.values
            self._history = replace(state.history, refined=False)  # what its refinement changed has been observed
            del self.records[-1]
            self._last["record"] = self.records[-1] if self.records else None
            return
        marked, self._history = control.marked(*progress, self._comm)
        times = np.maximum(marked, state.refine)
        self._forest, self._values = state.forest.refined_with(times, state.values)

    def _refine(self):
        """The next forest from the last step, which is given up: Stages of the next step."""
        step, settings = self.step, self._settings
        _check_penalty(step, settings)
        stages = self._stages(step.record.step + 1)
        with stages("refine"):
            marked, self._history = settings.control.marked(
                step.estimate, settings.tolerance, step.history, self._comm
            )
            times = np.zeros(len(step.forest), dtype=np.int8)
            times[step.leaf_mesh.leaf] = marked
            times = np.maximum(times, step.contact_error.refine)
            values = np.concatenate([step.nodal_displacement, step.carried], axis=2)
            self._forest, self._values = step.forest.refined_with(times, values)
        self.step = None
        return stages

    def _solve(self, stages):
        """Distribute the forest anew, solve on it, and keep the step."""
        with stages("partition"):
            give_back()
            if self._values is not None:
                self._forest, self._values = repartition(self._forest, self._values, self._kind)
            partition = PartitionSummary.of(self._forest, self._kind)
        with stages("hanging"):
            space = Space(self._forest, self._settings.degree)
            start = self._start(Prolongation(space, needed_keys(self._settings.scene, space)))
        self._last.update(forest=self._forest, displacement=start.displacement)
        self.step = solve_step(self._settings, len(self.records), start, partition, stages)
        self._last.update(record=self.step.record, displacement=self.step.solution.displacement)
        self.records.append(self.step.record)
        if self._writer is not None:
            with stages("output"):
                self._writer.save(self.step, self.records)
            record = replace(self.step.record, **stages.costs(self._comm))
            self.step = replace(self.step, record=record)
            self._last["record"] = self.records[-1] = record

    def _start(self, prolongation):
        """StepStart from the values that the leaves carry, which are used up."""
        values, self._values = self._values, None
        if values is None:
            displacement, carried = np.zeros((prolongation.owned, 3)), np.zeros((*prolongation.space.cells.shape, 0))
        else:
            leaf, node = prolongation.space.example.T
            displacement, carried = prolongation.injected(values[leaf, node, :3]), values[..., 3:].copy()
        return StepStart(prolongation, displacement, carried, self._history)

    def _stages(self, number):
        """Stages of a step, told to who wants to know."""
        progress = self._progress
        return Stages(progress and (lambda name: progress(number, name)))


def _check_penalty(step, settings):
    """See that there is something to refine for: a penalty's own error no mesh takes away.  Local.

    Raises:
        SolveError: the estimate has met the tolerance, but the penalty takes more of a force than its square.
    """
    tolerance = settings.tolerance
    if not step.contact_error.leaves and settings.control.sought(step.estimate, tolerance, step.history) is None:
        raise SolveError(
            f"the penalty is too soft for the tolerance: penetration takes {percent(step.record.penalty_share)} of "
            f"a contact force, a tolerance of {percent(tolerance)} allows {percent(tolerance**2)}, its square; "
            "take a larger factor, or the default enforcement 'exact'"
        )


def _first_forest(scene, comm, kind):
    """The root cells, refined alike until every rank can have some; on few ranks they are not refined."""
    forest = Forest.of_roots(comm, scene.mesh, scene.pairing, scene.contact_surfaces)
    while True:
        try:
            return repartition(forest, None, kind)[0]
        except PartitionError:
            if forest.size_global > 64 * comm.size:
                raise
        forest, _ = forest.refined(np.ones(len(forest), dtype=bool))
