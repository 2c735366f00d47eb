"""Load paths: scenes that depend on a number, each solved from the solution of the one before.

A sweep may take its points in any order, on coarsened forests; increments go on from the state before, with a history.
"""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from inspect import signature
from pathlib import Path
from typing import Any, Self

from mpi4py import MPI

from fx_contact.adaptive.adaptive_loop import Run, adapt
from fx_contact.adaptive.checkpoint import NAME, Checkpoint, CheckpointWriter
from fx_contact.adaptive.checkpoint_file import CheckpointFile
from fx_contact.adaptive.solving import arguments_of
from fx_contact.adaptive.state import State, places
from fx_contact.adaptive.step import Step
from fx_contact.adaptive.step_record import StepRecord
from fx_contact.adaptive.step_report import table_head, table_row
from fx_contact.parallel.agreement import check_alike
from fx_contact.parallel.errors import CheckpointError, PartitionError, SceneError
from fx_contact.parallel.meeting import calling, collective
from fx_contact.parallel.mpi import together
from fx_contact.parallel.validation import (
    as_path,
    check_comm,
    check_count,
    check_flag,
    check_number,
    check_tolerance,
    percent,
    shown,
)
from fx_contact.path.repetition import Repetition, repeated_path
from fx_contact.path.starts import carried_over, next_increment, same_root
from fx_contact.path.sweep_record import SweepRecord, write_sweep
from fx_contact.scene.scene import Scene, check_scene
from fx_contact.verdict.model_warning import REFUSED

#: Starts of a point (`SweepRecord.begun`).
ANEW, COARSE, BEFORE = "anew", "coarse", "before"


@collective("comm")
def sweep(
    scene_of: Callable[[float], Scene],
    values: Iterable[float],
    tolerance: float,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    *,
    folder: str | Path | None = None,
    restart: bool = False,
    **options: Any,
) -> "LoadPath":
    """Solve scenes that depend on a number (approach, force, modulus), each to a prescribed accuracy.

    Collective on comm; so is every point of the iteration.  A point begins with the displacement of the one before on
    its coarsened forest (`carried_over`), or anew if the root mesh or the contact pairs of the scene change.
    Contact without friction has no history: the points may be solved in any order.

    Args:
        scene_of: scene of a value; called collectively, in turn.
        values: of the parameter, numbers.
        tolerance: prescribed relative error e in the energy norm of each point, (6) [-].
        folder: for `sweep.jsonl`, `sweep.csv` and the checkpoint of the last point; None: nothing is written.
        restart: continue after the last point in that folder; further `values` may follow the old ones.
        options: of `adapt`, for each point; a `beginning` is for points that begin anew.

    Raises:
        SceneError: values are no finite numbers, arguments differ between ranks, all scenes are the same, or as
            `adapt`.
        CheckpointError: there is nothing to restart from, or it is of other values, another problem or other options.
        OutputError: the folder cannot be written, or has the checkpoint of another run.
        FxContactError: as `adapt`, while a point is solved.
    """
    return LoadPath("sweep", scene_of, values, tolerance, comm, folder=folder, restart=restart, **options)


@collective("comm")
@arguments_of(sweep)
def increments(*arguments: Any, **options: Any) -> "LoadPath":
    """Solve scenes in order, each from the state before: as `sweep`, for laws with a history.

    Collective on comm; so is every point of the iteration.  A point begins on the forest of the one before, which is
    refined and never coarsened: interpolation on coarser leaves would change the history.  Each of its meshes has the
    displacement of the point before as the field `step_solver.HISTORY`; fields that a `beginning` carries go along.

    Args and Raises: as `sweep`; also SceneError if the root mesh or the contact pairs of the scene change.
    """
    signature(sweep).bind(*arguments, **options)
    return LoadPath("increments", *arguments, **options)


def _checked(scene_of: object, values: Iterable[float], tolerance: float, options: dict[str, Any]) -> list[float]:
    """The values as numbers.  Raises SceneError unless a load path can have these arguments, TypeError as `adapt`."""
    if not callable(scene_of):
        raise SceneError(f"scene_of must be a function of a value that gives a Scene, got {shown(scene_of)}")
    try:
        numbers = list(values)
    except TypeError:
        raise SceneError(f"the values of a load path must be a list of numbers, got {shown(values)}") from None
    if not numbers:
        raise SceneError("the values of a load path must be one number at least, got none")
    signature(adapt).bind(scene_of, tolerance, **options)
    check_tolerance("the tolerance", tolerance)
    for name in ("checkpoint", "restart"):
        if name in options:
            raise SceneError(f"a load path takes no {name!r} of adapt: it keeps its last point in its own folder")
    return [check_number("a value of a load path", number) for number in numbers]


@dataclass(frozen=True, eq=False)
class SweepPoint:
    """A solved point of a load path: value of the parameter, last step, record."""

    value: float
    step: Step
    record: SweepRecord

    def __str__(self) -> str:
        return str(self.record)


class LoadPath:
    """A load path: an iterator of its points, made by `sweep` or `increments`.  Collective on comm.

    Attributes:
        records: of all points so far, with those before a restart.

    Raises:
        Error, SceneError: as `sweep`.
    """

    def __init__(
        self,
        kind: str,
        scene_of: Callable[[float], Scene],
        values: Iterable[float],
        tolerance: float,
        comm: MPI.Intracomm = MPI.COMM_WORLD,
        *,
        folder: str | Path | None = None,
        restart: bool = False,
        **options: Any,
    ) -> None:
        check_comm(comm)
        with together(comm):
            self._values = _checked(scene_of, values, tolerance, options)
            check_flag("restart of a load path, whose folder is `folder`,", restart)
            if restart and folder is None:
                raise SceneError("a load path restarts from the folder of one before: name it")
            self._folder = None if folder is None else as_path("the folder of a load path", folder)
        name = self._folder and str(self._folder)
        check_alike(comm, {"values": self._values, "folder of a load path": name, "restart": bool(restart)})
        self.records: list[SweepRecord] = []
        self._kind, self._scene_of, self._tolerance, self._comm = kind, scene_of, tolerance, comm
        self._options = options
        self._handed_out = False  # all points, in a loop
        self._writer: CheckpointWriter | None = None
        self._before: Checkpoint | None = None  # to restart from
        self._last: State | None = None  # of the last point
        self._first: dict[str, Any] | None = None  # problem of the first point
        self._alike = not restart  # all problems so far
        if restart and self._folder is not None:
            self._resume(self._folder)

    def __iter__(self) -> Self:
        if self._handed_out:
            raise SceneError(
                "the points of this LoadPath have been solved and handed out: `records` has the figures of all; "
                "list(...) keeps the points, with their memory"
            )
        return self

    def __repr__(self) -> str:
        rows = (f"{point.value:>11.5g}  {table_row(point.record)}" for point in self.records)
        told = (f"at {p.value:g}: {warning}" for p in self.records for warning in p.record.doubts)
        done = f"{len(self.records)} of {len(self._values)} points"
        caption = f"load path, tolerance {percent(self._tolerance)}: {done}, the last step of each"
        return "\n".join([caption, f"{'value':>11}  {table_head()}", *rows, *told])

    def __getitem__(self, index: object) -> SweepPoint:
        raise SceneError(
            f"a LoadPath has no point {shown(index)}: it yields one after the other, and `records` has the figures of "
            "all; list(...) keeps the points, with their memory"
        )

    def __next__(self) -> SweepPoint:
        if len(self.records) >= len(self._values):
            self._handed_out = self._last is not None
            raise StopIteration
        with calling(self._comm, f"the next point of {self._kind}"):
            return self._point()

    def _point(self) -> SweepPoint:
        value = self._values[len(self.records)]
        scene = self._scene_of(value)
        with together(self._comm):
            check_scene(scene)
        start = time.process_time()
        run, begun = self._run(scene)
        step = run.last_step()
        compiled = sum(one.cpu_seconds["compile"] for one in run.records)
        record = SweepRecord(
            point=len(self.records),
            value=value,
            begun=begun,
            solves=len(run.records),
            unknowns=sum(one.dofs for one in run.records),
            cpu_seconds=self._comm.allreduce(time.process_time() - start) - compiled,
            record=step.record,
            dissipated_energy=self._dissipated(step.record),
        )
        self.records.append(record)
        self._last = State.of(step)
        if self._folder is not None and self._writer is not None:
            points = [record.as_json() for record in self.records]
            path = {"problem": run.settings.problem, "points": points, "kind of load path": self._kind}
            self._writer.save(step, [step.record], path)
            write_sweep(self._folder, self._comm, self.records)
        return SweepPoint(value, step, record)

    def _dissipated(self, record: StepRecord) -> float | None:
        """Energy that friction has dissipated up to a new record, in increments [J].  Local."""
        before = self.records[-1].dissipated_energy if self.records and self._kind == "increments" else None
        if record.dissipated_energy is None:
            return before
        return (before or 0.0) + record.dissipated_energy

    def _run(self, scene: Scene) -> tuple[Run, str]:
        """The Run of a scene after its first step, and its start.  Collective."""
        options, last = self._options, self._last
        if last is None or not same_root(last, scene):
            if last is not None and self._kind == "increments":
                raise SceneError(
                    "the root mesh or the contact pairs of the scene change between two increments, which go on from "
                    "the state before: a sweep may begin anew"
                )
            return self._begun(scene, options), ANEW
        if self._kind == "increments":
            return self._begun(scene, options | {"beginning": next_increment(last)}), BEFORE
        try:
            begin = carried_over(last, self._tolerance, options.get("partition_kind", "contact-sfc"))
            return self._begun(scene, options | {"beginning": begin}), COARSE
        except PartitionError:  # the coarse forest has too few leaves for the ranks
            return self._begun(scene, options), ANEW

    def repeated(self, parts: int = 1, unloaded: float | None = None) -> Repetition:
        """The solved points once more, from rest on the mesh of the last one, each load step in equal parts.

        Collective.  The change is that of meshes of earlier points, and of the size of the load steps.

        Args:
            parts: number of parts.
            unloaded: value without load, from which the first load step is divided; None: it is not.

        Raises:
            SceneError: parts is no number from 1 on, no point of `increments` is solved, or as `adapt`.
            FxContactError: as `adapt`.
        """
        with calling(self._comm, "the repetition of a load path"), together(self._comm):
            check_count("the number of parts", parts)
            if unloaded is not None:
                check_number("the value without load", unloaded)
            if self._kind != "increments" or self._last is None:
                raise SceneError(
                    "only solved points of `increments` can be repeated: those of a sweep have no history"
                )

        def solved(value: float, state: State) -> Step:
            """The first step of a value, which begins at a state."""
            options = self._options | {"max_steps": 1, "beginning": state}
            return adapt(self._scene_of(value), self._tolerance, self._comm, **options).last_step()

        return repeated_path(self._last, self.records, solved, parts, unloaded)

    def _begun(self, scene: Scene, options: dict[str, Any]) -> Run:
        """A Run of a scene after its first step.  Collective."""
        run = adapt(scene, self._tolerance, self._comm, **options)
        if self._folder is not None and self._writer is None:
            self._writer = CheckpointWriter(self._folder, self._comm, run.settings, self._before)
        with together(self._comm):
            self._check_varied(run.settings.problem)
        run.advance()
        return run

    def _check_varied(self, problem: dict[str, Any]) -> None:
        """Raises SceneError before the last point if all scenes are the same, and the values are not.  Local."""
        self._alike &= problem == (self._first or problem)
        self._first = self._first or problem
        if self._alike and len(self.records) + 1 == len(self._values) and len({*self._values}) > 1:
            raise SceneError("the scenes of all values are the same: scene_of must use its argument")

    def _resume(self, folder: Path) -> None:
        """Continue after the last point in the folder.  Collective."""
        path, comm = folder / NAME, self._comm
        content = CheckpointFile(path, comm).content
        points = content.get("points")
        with together(comm):
            kind = "a single run" if points is None else content["kind of load path"]
            if kind != self._kind:
                raise CheckpointError(f"{str(path)!r} is of {kind}, not of {self._kind}: name another folder")
            self.records = [SweepRecord.from_json(entries) for entries in points]
            solved = [record.value for record in self.records]
            if solved != self._values[: len(solved)]:
                raise CheckpointError(
                    f"{str(path)!r} belongs to a load path over {shown(solved)}, and the values now begin with "
                    f"{shown(self._values[: len(solved)])}: give the same, and more if you like"
                )
        scene = self._scene_of(solved[-1])
        before = self._before = Checkpoint(folder, scene, comm)
        options = self._options | {"allow": tuple(REFUSED)}  # the last increment may have no load
        settings = adapt(scene, self._tolerance, comm, **options).settings
        with together(comm):
            before.check(settings)
        self._last = replace(before.load(), moved=places(scene))
        write_sweep(folder, comm, self.records)
