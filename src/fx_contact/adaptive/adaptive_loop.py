"""The adaptive loop: solve, estimate, mark, refine, repartition."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

from mpi4py import MPI

from fx_contact.adaptive.beginning import Beginning, first_forest
from fx_contact.adaptive.checkpoint import Checkpoint, CheckpointWriter
from fx_contact.adaptive.settings import DEGREE, Settings
from fx_contact.adaptive.state import State
from fx_contact.adaptive.step import Step
from fx_contact.adaptive.step_record import StepRecord
from fx_contact.adaptive.step_report import print_row, table_head, table_row
from fx_contact.adaptive.step_solver import solve_step
from fx_contact.contact.enforcement import Enforcement
from fx_contact.estimate.error_control import ErrorControl
from fx_contact.estimate.quantities import Quantity
from fx_contact.forest.partition import KINDS
from fx_contact.forest.partition_quality import PartitionSummary
from fx_contact.linalg.solver_options import Solver
from fx_contact.parallel.agreement import check_alike
from fx_contact.parallel.errors import FxContactError, SceneError, SolveError
from fx_contact.parallel.meeting import calling, collective
from fx_contact.parallel.memory import give_back
from fx_contact.parallel.mpi import together
from fx_contact.parallel.timing import Stages
from fx_contact.parallel.validation import check_comm, check_count, check_name, check_same_comm, percent, shown
from fx_contact.scene.scene import Scene
from fx_contact.verdict.model_warning import check_model_warnings, growing_pressure
from fx_contact.verdict.solution_warnings import load_warnings


@collective("comm")
def adapt(
    scene: Scene,
    tolerance: float,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    *,
    degree: int = DEGREE,
    max_steps: int = 20,
    geometry_order: int | None = None,
    enforcement: Enforcement | None = None,
    solver: Solver | None = None,
    control: ErrorControl | None = None,
    goals: Quantity | Sequence[Quantity] = (),
    partition_kind: str = "contact-sfc",
    allow: str | Sequence[str] = (),
    beginning: Beginning | State | None = None,
    checkpoint: str | Path | None = None,
    restart: Checkpoint | str | Path | None = None,
    progress: bool | Callable[[int, str], None] | None = None,
) -> "Run":
    """Solve a scene to a prescribed accuracy by adaptive refinement.

    Collective on comm; so is every step of the iteration.  Where only the last step counts, `solve` takes less memory.
    All arguments but progress must be the same on all ranks.

    Args:
        scene: bodies, materials, conditions, loads and contacts.
        tolerance: prescribed relative error e of the stress in the energy norm, (6), below 1 [-].
        comm: of all ranks that solve the scene.
        degree: p of the displacements, 1 or 2.
        max_steps: largest number of solves, with those before a restart.
        geometry_order: order of the leaf maps; None: the lowest that approximates the root map to
            `settings.GEOMETRY_SHARE` times the tolerance.
        enforcement: of contact; None: exact.
        solver: preconditioner and tolerance of the linear solver; None: by default.
        control: mode of refinement and stopping; None: errors of stresses and contact forces.
        goals: further quantities with tolerances of their own: ContactForce, FrictionForce, Gap, MaxPressure,
            Displacement, Reaction.
        partition_kind: a key of `partition.KINDS`.
        allow: kinds of model warnings that are no errors here, keys of `model_warning.REFUSED`: "large strain", "large
            rotation", "no load".
        beginning: forest and displacement to start from; None: the root cells.
        checkpoint: folder for the last step, written before it is yielded; None: no checkpoints.
        restart: checkpoint, or its folder; the run continues with its next step, or solves the last one again if
            there is none.
        progress: True: rank 0 prints the row of each step, as of `print(run)`, on standard error.  A function is called
            on every rank with the number of the step and the stage (`timing.STAGES`) that begins; it must not raise.

    Returns:
        An iterator of Step, until xi / (e omega) <= 1 (6), or max_steps are done.  By default xi of a first
        mesh is divided by an assumed effectivity, and contact is resolved (`ErrorControl`).

    Raises:
        SceneError: a tolerance that is not positive, another degree, an order above that of the root mesh, an unknown
            partition or kind of warnings, a progress that is no function, a beginning of another scene, arguments that
            differ between ranks.
        PartitionError: a rank would get no leaf.
        GeometryError: leaves of the finest level are to be refined.
        CheckpointError: the checkpoint is damaged, or of a run with another scene, degree, enforcement or geometry
            order.
        OutputError: a checkpoint cannot be written, or would replace that of another run.
        CompilationError: there is no C compiler, or no writable cache folder.
        ValidityError: nothing loads the scene, or strains or rotations are far from small (`model_warning`).
        SolveError: a solve fails, or would not fit into the memory; a penalty is too soft for the tolerance.
        Steps yielded before stay valid; an `FxContactError` holds the last state.
    """
    check_comm(comm)
    check_alike(comm, {"restart": str(restart) if isinstance(restart, (str, Path)) else None})
    source = Checkpoint(restart, scene, comm) if isinstance(restart, (str, Path)) else restart
    with together(comm):
        settings = Settings(
            scene,
            tolerance,
            geometry_order,
            Enforcement() if enforcement is None else enforcement,
            Solver() if solver is None else solver,
            ErrorControl() if control is None else control,
            degree=degree,
            allow=allow,
            goals=(goals,) if isinstance(goals, Quantity) else goals,
            moved_before=beginning.moved if isinstance(beginning, State) else {},
        )
        check_count("max_steps", max_steps)
        check_name("partition", partition_kind, KINDS)
        if not (progress is None or isinstance(progress, bool) or callable(progress)):
            wanted = "True, or a function of a step's number and a stage's name"
            raise SceneError(f"progress must be {wanted}, got {shown(progress)}")
        _check_start(settings, comm, beginning, source)
        state = beginning.state(settings.degree) if isinstance(beginning, Beginning) else beginning
        entries = settings.entries() | {
            "most steps": max_steps,
            "partition": partition_kind,
            "fields that a beginning carries": None if state is None else dict(state.fields.sizes),
            "checkpoint": None if checkpoint is None else str(checkpoint),
            "restart": None if source is None else [str(source.path), len(source.records)],
        }
    check_alike(comm, entries)
    writer = None if checkpoint is None else CheckpointWriter(checkpoint, comm, settings, source)
    return Run(settings, comm, max_steps, partition_kind, source or state, writer, progress)


def _check_start(
    settings: Settings, comm: MPI.Intracomm, beginning: Beginning | State | None, restart: Checkpoint | None
) -> None:
    """Raises SceneError or CheckpointError unless a run can begin there, ValidityError without loads.  Local."""
    if not settings.scene.contact:  # without loads contact may be open, as on a path through zero
        check_model_warnings(load_warnings(settings.scene), settings.allow)
    starts: tuple[tuple[str, object, type], ...]
    starts = ("restart", restart, Checkpoint), ("beginning", beginning, Beginning)
    for name, value, kind in starts:
        if not isinstance(value, kind | State | None):
            raise SceneError(f"{name} must be a {kind.__name__}, got {shown(value)}")
    if beginning is not None and restart is not None:
        raise SceneError("a run begins at a Beginning or restarts from a Checkpoint, not both")
    if restart is not None:
        check_same_comm("the checkpoint to restart from", restart.comm, comm)
        restart.check(settings)
    if isinstance(beginning, Beginning):
        beginning.check(settings.scene, comm)


class Run:
    """A run of the adaptive loop: an iterator of its steps, shown as a table of them.

    Collective on comm.  `adapt` makes it, from its arguments.

    Attributes:
        step: solved last; None before the first, and while the next is being solved.
        records: of all steps so far.
    """

    def __init__(
        self,
        settings: Settings,
        comm: MPI.Intracomm,
        max_steps: int,
        partition_kind: str,
        source: State | Checkpoint | None,
        writer: CheckpointWriter | None,
        progress: bool | Callable[[int, str], None] | None,
    ) -> None:
        self.step: Step | None = None
        self.records: list[StepRecord] = []
        self.settings, self._comm, self._kind = settings, comm, partition_kind
        self._max_steps, self._source, self._writer, self._progress = max_steps, source, writer, progress
        self._finished = False
        self._last: dict[str, Any] = {"record": None, "forest": None, "displacement": None}  # for FxContactError

    def __iter__(self) -> Self:
        return self

    def __repr__(self) -> str:
        told = (str(warning) for record in self.records[-1:] for warning in record.doubts)
        state = "no step yet" if not self.records else "reached" if self.records[-1].reached else "not reached"
        caption = f"run of {self.settings.scene.name!r}, tolerance {percent(self.settings.tolerance)}: {state}"
        return "\n".join([caption, table_head(), *map(table_row, self.records), *told])

    def __getitem__(self, index: object) -> Step:
        raise SceneError(
            f"a Run has no step {shown(index)}: it yields one after the other, and frees each before the next; "
            "solve(...) or `last_step()` gives the last one, `records` has the figures of all"
        )

    def __next__(self) -> Step:
        if not self.advance():
            raise StopIteration
        return self._solved()

    def last_step(self) -> Step:
        """Solve all steps that are left, and return the last one.

        Collective.

        Raises:
            FxContactError: as `adapt`.
        """
        while self.advance():
            pass
        return self._solved()

    def advance(self) -> bool:
        """Solve the next step; False if there is none.

        Collective.

        Raises:
            FxContactError: as `adapt`; then the run is over.
        """
        if self._finished:
            return False
        with calling(self._comm, "the next step of adapt"):
            self._finished = True  # unless this ends well
            try:
                self._solve(*(self._begin() if self.step is None else self._refine()))
            except FxContactError as error:
                vars(error).update(self._last)
                raise
        record = self._solved().record
        self._finished = record.reached or record.step >= self._max_steps - 1
        return True

    def _solved(self) -> Step:
        """The step solved last."""
        assert self.step is not None, "no step has been solved"
        return self.step

    def _begin(self) -> tuple[State, Stages]:
        """The state to solve first, from the source, on the ranks of the partition; Stages of the first step."""
        source, self._source = self._source, None
        stages = self._stages(len(source.records) if isinstance(source, Checkpoint) else 0)
        if source is None:
            with stages("partition"):
                forest = first_forest(self.settings.scene, self._comm, self._kind)
                return State.at_rest(forest, self.settings.degree), stages
        if isinstance(source, Checkpoint):
            with stages("refine"):
                source = self._resumed(source)
        return self._moved(source, stages), stages

    def _resumed(self, checkpoint: Checkpoint) -> State:
        """The state to continue from: of the next mesh, or of the last one again if there is none."""
        state = checkpoint.load()
        self.records = list(checkpoint.records)
        if state.is_accurate(self.settings) or len(self.records) >= self._max_steps:
            del self.records[-1]
        else:
            state = state.refined(self.settings, self.records)
        self._last["record"] = self.records[-1] if self.records else None
        return state

    def _refine(self) -> tuple[State, Stages]:
        """The state on the refined forest of the last step, which is freed; Stages of the next step."""
        step, settings = self._solved(), self.settings
        _check_penalty(step, settings)
        stages = self._stages(step.record.step + 1)
        with stages("refine"):
            state = State.of(step).refined(settings, self.records)
        self.step = None
        del step
        return self._moved(state, stages), stages

    def _moved(self, state: State, stages: Stages) -> State:
        """A state on the ranks of the partition."""
        with stages("partition"):
            give_back()
            return replace(state, fields=state.fields.repartitioned(self._kind))

    def _solve(self, state: State, stages: Stages) -> None:
        """Solve on the forest of a state, and keep the step."""
        settings = self.settings
        with stages("partition"):
            partition = PartitionSummary.of(state.forest, self._kind)
        with stages("hanging"):
            start = state.start(settings)
            del state
        self._last.update(forest=start.forest, displacement=start.displacement)
        step = solve_step(settings, len(self.records), start, partition, stages)
        figures = [(record.max_pressure, record.active_pairs) for record in (*self.records, step.record)]
        growing = growing_pressure(settings.scene.name, *zip(*figures))
        if growing:
            step = replace(step, record=replace(step.record, doubts=[*step.record.doubts, *growing]))
        self.step = step
        self._last.update(record=step.record, displacement=step.solution.displacement)
        self.records.append(step.record)
        if self._writer is not None:
            with stages("output"):
                self._writer.save(step, self.records)
            self.step = replace(step, record=replace(step.record, **stages.costs(self._comm)))
            self._last["record"] = self.records[-1] = self.step.record
        if self._progress is True and self._comm.rank == 0:
            print_row(self.records[-1], first=len(self.records) == 1)

    def _stages(self, number: int) -> Stages:
        """Stages of a step, reported to the user's progress."""
        progress = self._progress
        return Stages((lambda name: progress(number, name)) if callable(progress) else None)


def _check_penalty(step: Step, settings: Settings) -> None:
    """Raises SolveError if only the error of a penalty is left, which no mesh reduces.  Local."""
    tolerance, theta = settings.tolerance, step.record.assumed_effectivity
    if not step.contact_error.leaves and settings.control.sought(step.estimate, tolerance, theta) is None:
        share = percent(step.record.penalty_share or 0.0)
        raise SolveError(
            f"the penalty is too soft for the tolerance: penetration takes {share} of "
            f"a contact force, a tolerance of {percent(tolerance)} allows {percent(tolerance**2)}, its square; "
            "take a larger factor, or the default enforcement 'exact'"
        )
