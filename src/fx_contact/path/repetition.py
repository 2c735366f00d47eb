"""A load path solved again on its last mesh: the effect of earlier meshes, and of the size of the load steps."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fx_contact.adaptive.state import State
from fx_contact.adaptive.step import Step
from fx_contact.adaptive.step_record import StepRecord
from fx_contact.parallel.validation import percent
from fx_contact.path.starts import COMPARED, at_rest, next_increment
from fx_contact.path.sweep_record import SweepRecord


@dataclass(frozen=True, eq=False)
class Repetition:
    """Changes of a load path by solving it again on its last mesh.

    Attributes:
        parts: of each load step.
        unloaded: value from which the first load step is divided; None: it is not.
        values: of the points.
        records: of the points, solved again.
        forces: change of the contact forces at each point, the largest of all pairs, relative to the force [-].
        displacement: change of the last displacement in the energy norm, relative to it [-].
    """

    parts: int
    unloaded: float | None
    values: list[float]
    records: list[StepRecord]
    forces: list[float]
    displacement: float

    def __str__(self) -> str:
        first = "" if self.unloaded is not None else " after the first"
        parts = f", each load step{first} in {self.parts} parts" if self.parts > 1 else ""
        forces = ", ".join(f"{percent(change)} at {value:g}" for value, change in zip(self.values, self.forces))
        return (
            f"the load path again on its last mesh{parts}: the last displacement changes by "
            f"{percent(self.displacement)} (energy norm), forces by {forces}"
        )


def repeated_path(
    last: State, points: list[SweepRecord], solved: Callable[[float, State], Step], parts: int, unloaded: float | None
) -> Repetition:
    """The points of a load path, solved again from rest on the mesh of the last one.

    Collective on last.forest.comm.

    Args:
        last: state after the last point.
        points: records of the points.
        solved: the step of a value on the mesh of a state.
        parts: of each load step.
        unloaded: value from which the first load step is divided; None: it is not.
    """
    records, state, before = list[StepRecord](), at_rest(last), unloaded
    values = [point.value for point in points]
    for value in values:
        first = value if before is None else before
        for part in range(1, parts + 1) if first != value else [parts]:
            step = solved(value if part == parts else first + part * (value - first) / parts, state)
            state = next_increment(State.of(step))
        records.append(step.record)
        before = value
    prolongation, norm = step.elasticity.prolongation, step.elasticity.energy_norm
    displacement = prolongation.injected(step.fields.at_nodes(prolongation.space, COMPARED))
    change = norm(step.solution.displacement - displacement) / (norm(displacement) or 1.0)
    forces = [_change(new, point.record) for new, point in zip(records, points)]
    return Repetition(parts, unloaded, values, records, forces, float(change))


def _change(new: StepRecord, old: StepRecord) -> float:
    """Largest change of a contact force, relative to it [-]."""
    pairs = zip(new.resultants or (), old.resultants or ())
    forces = [(np.array(one.force), np.array(other.force)) for one, other in pairs if one.kind == "contact"]
    changes = (float(np.linalg.norm(one - other) / (np.linalg.norm(other) or 1.0)) for one, other in forces)
    return max(changes, default=0.0)
