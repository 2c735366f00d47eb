"""The adaptive loop: solve, estimate, mark, refine, repartition; a record and the solution a step."""

from dataclasses import asdict, dataclass, replace

import numpy as np
from mpi4py import MPI

from fx_contact.adaptive.checkpoint import Checkpoint, CheckpointWriter
from fx_contact.adaptive.step import DEGREE, Settings, check_step, solve_step
from fx_contact.contact.enforcement import Enforcement
from fx_contact.estimate.effectivity import RefinementHistory
from fx_contact.estimate.error_control import ErrorControl
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.forest.forest import Forest
from fx_contact.forest.partition import KINDS, repartition
from fx_contact.forest.partition_quality import brief
from fx_contact.linalg.solver_options import Solver
from fx_contact.parallel.agreement import check_alike
from fx_contact.parallel.errors import FxContactError, PartitionError, SceneError, SolveError
from fx_contact.parallel.memory import check_leaves
from fx_contact.parallel.mpi import together
from fx_contact.parallel.timing import Stages
from fx_contact.parallel.validation import check_comm, check_count, check_name, check_same_comm, shown
from fx_contact.problem.fingerprint import mesh_digest, scene_parts
from fx_contact.problem.lattice import MAX_LEVEL
from fx_contact.problem.scene import check_scene


@dataclass(frozen=True, eq=False)
class Beginning:
    """Where a run begins if not at the root cells; checked when it does.

    Attributes:
        forest: Forest on the root mesh of the scene; materials and conditions may be others than it was refined for.
        values: (n, (p+1)^3, 3 + k) float64 at the nodes of its leaves, p the degree of displacements (`DEGREE`): a
            first guess of the displacement [m], then any continuous fields of degree p, which go along through
            refinement and partition.
        history: RefinementHistory; None: nothing is known of the estimate, as on root cells.
    """

    forest: Forest
    values: np.ndarray
    history: RefinementHistory | None = None

    def check(self, scene, comm):
        """See that a run of a scene can begin here.

        Local.

        Args:
            scene: Scene.
            comm: MPI communicator of the run.

        Raises:
            SceneError: the forest is of another root mesh, has other contact pairs or another communicator, or the
                values are not finite numbers at the nodes of its leaves.
        """
        forest, values = self.forest, self.values
        for name, value, kind in (("forest", forest, Forest), ("history", self.history, RefinementHistory)):
            if not isinstance(value, kind) and not (name == "history" and value is None):
                raise SceneError(f"the {name} of a Beginning must be a {kind.__name__}, got {shown(value)}")
        check_same_comm("the forest of the Beginning", forest.comm, comm)
        if forest.mesh is not scene.mesh and mesh_digest(forest.mesh) != mesh_digest(scene.mesh):
            raise SceneError("the forest of the Beginning is of another root mesh than the scene: begin with its own")
        if not np.array_equal(forest.pairing.partner, scene.pairing.partner):
            raise SceneError("the forest of the Beginning has other contact pairs than the scene: begin with its own")
        if not isinstance(values, np.ndarray) or values.dtype != np.float64:
            raise SceneError(f"the values of a Beginning must be an array of float64, got {shown(values)}")
        shape = len(forest), (DEGREE + 1) ** 3
        if values.ndim != 3 or values.shape[:2] != shape or values.shape[2] < 3:
            raise SceneError(
                f"the values of a Beginning must be an array of shape ({shape[0]}, {shape[1]}, 3 or more), three "
                f"components of the displacement and other fields at the nodes of each leaf, got one of {values.shape}"
            )
        if not np.isfinite(values).all():
            raise SceneError("the values of a Beginning must be finite: they are a first guess of the displacement")

    @classmethod
    def uniform(cls, scene, levels, comm=MPI.COMM_WORLD):
        """The root cells, all of them refined alike, at rest.

        Collective on comm.

        Args:
            scene: Scene.
            levels: times to refine, up to `lattice.MAX_LEVEL`.
            comm: MPI communicator.

        Raises:
            SceneError: scene or levels are none, or differ between ranks.
            SolveError: so many leaves would not fit into the memory.
        """
        check_comm(comm)
        with together(comm):
            check_scene(scene)
            check_count("the number of refinements", levels, least=0)
            if levels > MAX_LEVEL:
                raise SceneError(f"root cells can be refined {MAX_LEVEL} times, got {levels}: take a finer root mesh")
            asked = scene_parts(scene) | {"number of refinements": int(levels)}
        check_alike(comm, asked)
        forest = Forest.of_roots(comm, scene.mesh, scene.pairing)
        check_leaves(comm, len(forest) * 8 ** int(levels))
        for _ in range(levels):
            forest, _ = forest.refined(np.ones(len(forest), dtype=bool))
        return cls(forest, np.zeros((len(forest), (DEGREE + 1) ** 3, 3)))

    @classmethod
    def after(cls, step, marked):
        """The forest of a step refined; its displacement is the first guess, and goes along, its estimate is trusted.

        Collective on the step's communicator.

        Args:
            step: Step.
            marked: (n,) bool, leaves to refine, or (n,) int, how often to refine each.

        Raises:
            SceneError: no step, or marked is no such array.
            GeometryError: leaves of the finest level are marked.
            SolveError: the new forest would not fit into the memory.
        """
        check_step(step)
        forest = step.forest
        with together(forest.comm):
            if not isinstance(marked, np.ndarray) or marked.dtype.kind not in "bui" or marked.shape != (len(forest),):
                raise SceneError(
                    f"marked must be an array of bool or whole numbers, one for each of the {len(forest)} leaves of "
                    f"this rank, got {shown(marked)}"
                )
            if not ((marked >= 0) & (marked <= MAX_LEVEL)).all():
                raise SceneError(
                    f"marked must say how often to refine each leaf, 0 to {MAX_LEVEL} times, got "
                    f"{marked.min()} to {marked.max()}"
                )
        history = RefinementHistory(step.history.effectivity, compared=True)
        return cls(*forest.refined_with(marked.astype(np.int8), np.tile(step.nodal_displacement, 2)), history)


def adapt(
    scene,
    tolerance,
    comm=MPI.COMM_WORLD,
    *,
    max_steps=20,
    geometry_order=None,
    enforcement=None,
    solver=None,
    control=ErrorControl(),
    partition_kind="contact-sfc",
    beginning=None,
    checkpoint=None,
    restart=None,
    progress=None,
):
    """Solve a scene to a prescribed accuracy, refining where the error is.

    Collective on comm; so is every step of the iteration.

    Args:
        scene: Scene.  It and all that follows must be the same on all ranks, but for progress.
        tolerance: prescribed relative error e in the energy norm, (6) [-].
        comm: MPI communicator.
        max_steps: most solves, with those before a restart.
        geometry_order: order of the leaf maps; None: the lowest that holds the root map to
            `step.GEOMETRY_SHARE` times the tolerance.
        enforcement: Enforcement of the contact conditions; None: the default one.
        solver: Solver; None: the default one.
        control: ErrorControl, what is refined for and when to stop.
        partition_kind: a key of `partition.KINDS`.
        beginning: Beginning; None: the root cells.
        checkpoint: folder in which every step is kept before it is yielded, in the place of the one before; None: not.
        restart: Checkpoint to go on from: with the next step, or with the same one again if that was the last.
        progress: function of a step's number and the name of one of its `stages.STAGES`, called on every rank whenever
            work on that stage begins; it must not raise.  None: nobody is told.

    Returns:
        Iterator of Step, until xi / (e omega) <= 1 (6), or max_steps are done.  By default xi is corrected by the
        measured effectivity, for which two meshes are needed at least, and contact is resolved (`ErrorControl`).

    Raises:
        SceneError: a tolerance that is not positive, an order above that of the root mesh, an unknown partition, a
            progress that is no function, a beginning of another scene, arguments that differ between ranks.
        PartitionError: a rank would get no leaf.
        GeometryError: leaves of the finest level are to be refined.
        CheckpointError: the checkpoint is damaged, or of a run with another scene, enforcement or geometry order.
        OutputError: a checkpoint cannot be written, or would replace that of another run.
        CompilationError: there is no C compiler, or no folder for what it makes.
        SolveError: a solve fails, or would not fit into the memory; a penalty is too soft for the tolerance.
        Whatever ends a run, what was yielded before stays valid, and the error holds the last state: `FxContactError`.
    """
    check_comm(comm)
    with together(comm):
        enforcement = Enforcement() if enforcement is None else enforcement
        solver = Solver() if solver is None else solver
        settings = Settings(scene, tolerance, geometry_order, enforcement, solver, control)
        check_count("max_steps", max_steps)
        check_name("partition", partition_kind, KINDS)
        if progress is not None and not callable(progress):
            raise SceneError(
                f"progress must be a function of a step's number and a stage's name, got {shown(progress)}"
            )
        options = {
            "geometry order": settings.geometry_order,
            "enforcement": asdict(enforcement),
            "error control": asdict(control),
        }
        _check_start(settings, comm, options, beginning, restart)
        asked = settings.asked() | {
            "most steps": max_steps,
            "partition": partition_kind,
            "fields that a beginning carries": None if beginning is None else beginning.values.shape[2],
            "checkpoint": None if checkpoint is None else str(checkpoint),
            "restart": None if restart is None else [str(restart.path), len(restart.records)],
        }
    check_alike(comm, asked)
    writer = None if checkpoint is None else CheckpointWriter(checkpoint, comm, settings.problem, options, restart)
    return _steps(settings, comm, max_steps, partition_kind, beginning, writer, restart, progress)


def _check_start(settings, comm, options, beginning, restart):
    """See that a run can begin where it is told to.  Local."""
    for name, value, kind in (("restart", restart, Checkpoint), ("beginning", beginning, Beginning)):
        if value is not None and not isinstance(value, kind):
            raise SceneError(f"{name} must be a {kind.__name__}, got {shown(value)}")
    if beginning is not None and restart is not None:
        raise SceneError("a run begins at a Beginning or restarts from a Checkpoint, not both")
    if restart is not None:
        check_same_comm("the checkpoint to restart from", restart.comm, comm)
        restart.check(settings.problem, options)
    if beginning is not None:
        beginning.check(settings.scene, comm)


class _Last:
    """The last state of a run: what errors hold (`errors.FxContactError`)."""

    def __init__(self):
        self.record = self.forest = self.displacement = None


def _steps(*arguments):
    """The steps that `adapt` yields; errors hold the last one."""
    last = _Last()
    try:
        yield from _loop(last, *arguments)
    except FxContactError as error:
        vars(error).update(vars(last))
        raise


def _loop(last, settings, comm, max_steps, partition_kind, beginning, writer, restart, progress):
    """Solve, refine, repartition, and remember the last state."""
    carried, records, history, again = None, [], settings.control.begin(), False
    stages = _stages(progress, len(restart.records) if restart else 0)
    if restart is not None:
        with stages("refine"):
            forest, carried, records, history = _resumed(restart, settings, max_steps)
        again = len(records) < len(restart.records)
        last.record = records[-1] if records else None
    elif beginning is not None:
        forest, carried = beginning.forest, beginning.values
        history = beginning.history or history
    else:
        with stages("partition"):
            forest = _first_forest(settings.scene, comm, partition_kind)
    del beginning, restart
    for number in range(len(records), max(max_steps, len(records) + 1)):
        with stages("partition"):
            if carried is not None:
                forest, carried = repartition(forest, carried, partition_kind)
            quality = brief(forest, partition_kind)
        with stages("hanging"):
            prolongation = Prolongation(Space(forest, DEGREE))
            start, along = _start(prolongation, carried)
            carried = None
        last.forest, last.displacement = forest, start
        # The last step of a run that goes on again: what its refinement changed has been observed.
        history, again = replace(history, refined=False) if again else history, False
        step = solve_step(settings, number, forest, prolongation, start, along, stages, quality, history)
        last.record, last.displacement = step.record, step.solution.displacement
        records.append(step.record)
        if writer is not None:
            with stages("output"):
                writer.save(step, records)
            step = replace(step, record=replace(step.record, **stages.costs(comm)))
            last.record = records[-1] = step.record
        yield step
        if step.record.reached or number >= max_steps - 1:
            return
        _check_penalty(step, settings)
        stages = _stages(progress, number + 1)
        with stages("refine"):
            forest, carried, history = _refine(step, settings)
        del step


def _check_penalty(step, settings):
    """See that there is something to refine for: a penalty's own error no mesh takes away.  Local.

    Raises:
        SolveError: the estimate has met the tolerance, but the penalty holds more of the energy than its square.
    """
    tolerance = settings.tolerance
    if not step.contact_error.leaves and settings.control.sought(step.estimate, tolerance, step.history) is None:
        raise SolveError(
            f"the penalty is too soft for the tolerance: overlaps take {step.record.penalty_share:.2%} of the energy "
            f"of contact, a tolerance of {tolerance:.1%} allows {tolerance**2:.2%}, its square; take a larger "
            "factor (or, with the augmented Lagrangian, a smaller gap_tolerance), or the default enforcement 'exact'"
        )


def _stages(progress, number):
    """Stages of a step, told to who wants to know."""
    return Stages(progress and (lambda name: progress(number, name)))


def _start(prolongation, carried):
    """First guess of the conforming displacement (owned, 3) from the values that the leaves carry, and the others."""
    if carried is None:
        return np.zeros((prolongation.owned, 3)), np.zeros((*prolongation.space.cells.shape, 0))
    leaf, node = prolongation.space.example.T
    return prolongation.injected(carried[leaf, node, :3]), carried[..., 3:].copy()


def _first_forest(scene, comm, kind):
    """The root cells, refined alike until every rank can have some; on few ranks they are not refined."""
    forest = Forest.of_roots(comm, scene.mesh, scene.pairing)
    while True:
        try:
            return repartition(forest, None, kind)[0]
        except PartitionError:
            if forest.size_global > 64 * comm.size:
                raise
        forest, _ = forest.refined(np.ones(len(forest), dtype=bool))


def _refine(step, settings):
    """The next forest, nodal displacement and further fields of its leaves (n, (p+1)^3, 3 + k), and the history."""
    times = np.zeros(len(step.forest), dtype=np.int8)
    marked, history = settings.control.marked(step.estimate, settings.tolerance, step.history, step.forest.comm)
    times[step.leaf_mesh.leaf] = marked
    times = np.maximum(times, step.contact_error.refine)
    forest, values = step.forest.refined_with(times, np.concatenate([step.nodal_displacement, step.along], axis=2))
    return forest, values, history


def _resumed(checkpoint, settings, max_steps):
    """The forest to go on with, the values its leaves carry, the records of the steps done, and the history."""
    state, records = checkpoint.load(), list(checkpoint.records)
    control, progress = settings.control, (state.estimate, settings.tolerance, state.history)
    more = state.forest.comm.allreduce(bool(state.refine.any()), op=MPI.LOR)
    if (control.sought(*progress) is None and not more) or len(records) >= max_steps:
        return state.forest, state.values, records[:-1], state.history
    marked, history = control.marked(*progress, state.forest.comm)
    times = np.maximum(marked, state.refine)
    return *state.forest.refined_with(times, state.values), records, history
