"""The line that a run shows of each step while it is being solved, if the user asks for it."""

import sys
import time
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

from mpi4py import MPI

from fx_contact.adaptive.step_record import StepRecord
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import percent, shown


class ProgressLine:
    """A live line for each step on standard error: unknowns, stage, estimate and target, seconds.

    Local.  In a terminal or notebook tqdm draws the line at each change of stage.  In a file, or without tqdm, it is
    printed once, when the step is done.

    Attributes:
        unknowns: of the present step, as soon as they are known.
        estimate: of the step before.
    """

    def __init__(self, tolerance: float) -> None:
        self.unknowns: int | None = None
        self.estimate: float | None = None
        self._target = percent(tolerance)
        self._bar: Any = None
        self._step: int | None = None  # that is being solved
        self._start = 0.0

    def __call__(self, step: int, stage: str) -> None:
        """Show the stage that begins."""
        if step != self._step:
            self._step, self._start = step, time.perf_counter()
            if find_spec("tqdm") and (sys.stderr.isatty() or "ipykernel" in sys.modules):
                from tqdm import tqdm

                self._bar = tqdm(bar_format="{desc}")
        if self._bar is not None:
            before = "" if self.estimate is None else f"error {percent(self.estimate)} before, "
            self._bar.set_description_str(self._line(f"{before}target {self._target}, {stage}"))

    def finish(self, record: StepRecord) -> None:
        """Show the result of a step, and end its line."""
        self.estimate, self.unknowns = record.estimate, record.dofs
        line = self._line(f"error {percent(record.estimate)}, target {self._target}")
        if self._bar is None:
            print(line, file=sys.stderr, flush=True)
        else:
            self._bar.set_description_str(line)
        self.close()

    def close(self) -> None:
        """End the line of the present step, if there is one."""
        if self._bar is not None:
            self._bar.close()
        self._bar = self._step = self.unknowns = None

    def _line(self, text: str) -> str:
        unknowns = "" if self.unknowns is None else f"{self.unknowns:,} unknowns, "
        return f"step {self._step}: {unknowns}{text}, {time.perf_counter() - self._start:.1f} s"


def watch_of(progress: object, tolerance: float, comm: MPI.Intracomm) -> Callable[[int, str], None] | None:
    """Observer of the stages on this rank, by the argument `progress` of `adapt`; None: there is none.

    Local.  Raises SceneError unless that is True, False, None or a function.
    """
    if progress is None or isinstance(progress, bool):
        return ProgressLine(tolerance) if progress and comm.rank == 0 else None
    if not callable(progress):
        raise SceneError(
            f"progress must be True, or a function of a step's number and a stage's name, got {shown(progress)}"
        )
    return progress
