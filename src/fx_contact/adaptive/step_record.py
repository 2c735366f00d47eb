"""The figures of one adaptive step, a line of `steps.jsonl`, and a report of them."""

from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from typing import Any, Self

import numpy as np

from fx_contact.adaptive.solve_record import SolveRecord
from fx_contact.estimate.goal_errors import GoalRecord
from fx_contact.forest.partition_quality import PartitionSummary
from fx_contact.items.units import Units, unit_of
from fx_contact.parallel.validation import percent
from fx_contact.verdict.contact_figures import ContactFigures
from fx_contact.verdict.model_warning import ModelWarning
from fx_contact.verdict.resultants import Resultant

#: Digits of the largest force; of others those with the same place value, the rest is the solver's error.
_DIGITS = 6
#: Least `pair_alignments` of a pair with one direction: its force is then the length of its force vector to 1 %.
DIRECTED = 0.99
#: Components shown as 0, relative to the sum of magnitudes: less than its digits.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class TrueError:
    """Error of a step against an over-refined solution u_fine.

    Attributes:
        distance: norm of u_h - u_fine over that of u_fine, both on the finer mesh [-].
        fine_estimate: estimated relative error of u_fine [-].
        fine_dofs: unknowns of u_fine.
        relative: true relative energy error of the step, (distance^2 + fine_estimate^2)^(1/2) by Galerkin
            orthogonality [-].
    """

    distance: float
    fine_estimate: float
    fine_dofs: int
    relative: float


class Motions(dict[str, float | list[float]]):
    """Motions by the names of interfaces; the name of its first surface will do."""

    def __missing__(self, name: str) -> float | list[float]:
        found = [known for known in self if known.startswith(f"{name} ")]
        if len(found) == 1:
            return self[found[0]]
        raise KeyError(
            f"{name!r} has no motion along a given force; {', '.join(map(repr, self)) or 'nothing'} has one"
        )


@dataclass(frozen=True, kw_only=True)
class StepRecord(SolveRecord, ContactFigures):
    """The figures of one adaptive step, with those of `SolveRecord` and `ContactFigures`; `print` shows a report.

    Units are those of the scene, here SI.

    Attributes:
        enforcement: `Enforcement.method`.
        control: `ErrorControl.mode`.
        contact_iterations: of the active set.
        preconditioner: the chosen one, or its replacement.
        assumed_effectivity: of the estimate: `ErrorControl.least_effectivity` on a first mesh, at last 1 [-].
        pair_errors: estimated error of each pair's force, relative to the force: in runs with goals that of a goal
            `ContactForce`, else an upper bound of it if the tolerance allows the bound; None where it is 0 or nothing
            is known [-].  With a force on the obstacle: as of `ContactForce`, at a fixed place.
        pair_leaves: leaves marked for the force of each contact pair.
        penetrated_leaves: leaves penetrated between nodes, which are marked; None: not computed.
        penalty_share: largest share of a pair's force that the penetration of a penalty takes [-]; None: not computed,
            before the energy error meets the tolerance.
        reached: True where the tolerance is reached.
        partition: of the forest.
        doubts: violated assumptions of the model, however small the error.
        errors: deviations from known values by name, relative to them [-]; None: nothing is known.
        true_error: None: not measured.
        effectivity: estimate over true error [-], or None.
        resultants: of contact pairs, loads, conditions, and the balance of each body.
        goals: of the run.
        motions: found along given forces, by the names of contact pairs, ties and rigid loads: how far an obstacle has
            moved from `moved`, or a section has closed [m]; of the surface of a rigid load three translations [m] and
            rotations [rad] about its point.
        free_motions: bodies that nothing holds and no load moves, by name, and how they could; None: there are none.
        remote_rows: number of rows of contact and ties with nodes of other ranks.
        yielded_rows: of those that yield to conditions, ties or other contacts at their nodes.
        units: names of those of length and stress, as `Scene.units`.
        expected_estimate: by the mesh before, if the solution is smooth; None: on a first mesh [-].
    """

    enforcement: str
    control: str
    contact_iterations: int
    preconditioner: str
    assumed_effectivity: float
    pair_errors: list[float | None]
    pair_leaves: list[int]
    penetrated_leaves: int | None
    penalty_share: float | None
    reached: bool
    partition: PartitionSummary
    doubts: list[ModelWarning] = field(default_factory=list)
    errors: dict[str, float] | None = None
    true_error: TrueError | None = None
    effectivity: float | None = None
    resultants: tuple[Resultant, ...] | None = None
    goals: tuple[GoalRecord, ...] = ()
    motions: Motions = field(default_factory=lambda: Motions())
    free_motions: dict[str, str] | None = None
    remote_rows: int = 0
    yielded_rows: int = 0
    units: Units = None
    expected_estimate: float | None = None

    def __str__(self) -> str:
        return f"{report_text(self)}\n  {costs(self)}"

    def as_json(self) -> dict[str, Any]:
        """The entries, without optional ones that are not known.  Local."""
        entries = super().as_json()
        return entries if self.motions else {name: value for name, value in entries.items() if name != "motions"}

    @classmethod
    def from_json(cls, entries: dict[str, Any]) -> Self:
        """A record from a line of `steps.jsonl`; entries of other versions are left out.

        Local.

        Raises:
            TypeError: the entries are no dict, or lack one.
        """
        known = {one.name: entries[one.name] for one in fields(cls) if one.name in entries}
        for name, kind in _KINDS.items():
            value = known.get(name)
            if isinstance(value, dict):
                known[name] = kind(**value)
            elif value is not None:
                rows = [{n: tuple(v) if isinstance(v, list) else v for n, v in row.items()} for row in value]
                known[name] = (list if name == "doubts" else tuple)(kind(**row) for row in rows)
        known["motions"] = Motions(known.get("motions", {}))
        if known.get("units") is not None:
            known["units"] = tuple(known["units"])
        return cls(**known)


#: Classes of entries that are objects or lists of them.
_KINDS: dict[str, type] = {
    "partition": PartitionSummary,
    "true_error": TrueError,
    "doubts": ModelWarning,
    "resultants": Resultant,
    "goals": GoalRecord,
}


def report_text(record: StepRecord) -> str:
    """Mesh, error, contact, resultants, goals and warnings of a step; without its costs."""
    return "\n  ".join(_lines(record))


def costs(record: StepRecord) -> str:
    """A line on time and memory."""
    wall, cpu = record.seconds["total"], record.cpu_seconds["total"]
    return f"{wall:.1f} s of wall time, {cpu:.1f} s of CPU time, {record.peak_memory_bytes / 1e6:,.0f} MB of memory"


def _lines(r: StepRecord) -> Iterator[str]:
    """Lines of `report_text`."""
    yield f"step {r.step} of {r.scene!r} on {r.ranks} rank{'s' * (r.ranks > 1)}"
    yield f"{r.cells:,} cells of order {r.geometry_order}, up to level {r.max_level}"
    yield f"{r.dofs:,} unknowns of degree {r.degree}, {r.hanging_nodes:,} hanging nodes"
    reached = "" if r.reached else " not"
    yield f"estimated error {percent(r.estimate)}, tolerance {percent(r.tolerance)}{reached} reached"
    if r.pair_forces:
        largest = f"largest pressure {r.max_pressure:.5g}{_unit(r, 'stress')}"
        radius = f", contact radius {r.contact_radius:.5g}{_unit(r, 'length')}" if r.contact_radius else ""
        yield f"{r.active_pairs:,} contact nodes closed, {largest}{radius}"
    if r.slipping_pairs is not None:
        yield f"friction: {r.sticking_pairs:,} nodes stick, {r.slipping_pairs:,} slip"
    yield from _contacts(r)
    yield from _resultants(r)
    for name, ways in (r.free_motions or {}).items():
        yield f"body {name!r} is free {ways}: no load moves it so"
    yield from map(str, r.goals)
    yield from map(str, r.doubts)
    yield from undirected(r)


def _contacts(r: StepRecord) -> Iterator[str]:
    """A line for each contact pair."""
    names = [one.name for one in r.resultants or () if one.kind == "contact"]
    for index, force in enumerate(r.pair_forces):
        error, moved = r.pair_errors[index], r.motions.get(names[index]) if names else None
        line = f"contact {repr(names[index]) if names else index}: "
        shown = f"force {force:.6g}{_unit(r, 'force')}" if abs(force) > _ROUNDING * max(r.pair_forces) else "no force"
        line += shown if force else "open"
        line += "" if error is None else f", estimated error {percent(error)}"
        yield line + ("" if moved is None else f", obstacle moved by {moved:.5g}{_unit(r, 'length')}")
        area = r.pair_areas[index] if r.pair_areas else 0.0
        if area and shown[0] == "f":
            mean = f"mean pressure {force / area:.3g}{_unit(r, 'stress')}"
            yield f"  area {area:.3g}{_unit(r, 'area')}, {mean}"


def _resultants(r: StepRecord) -> Iterator[str]:
    """A line for each tie, load and condition."""
    shown = [one for one in r.resultants or () if one.kind not in ("contact", "balance")]
    largest = max([r.force, *(abs(value) for one in shown for value in one.force)])
    digits = _DIGITS - 1 - int(np.floor(np.log10(largest))) if largest else 0
    for one in shown:
        motion = r.motions.get(one.name) if one.kind in ("tie", "rigid load") else None
        if one.kind == "symmetry" and not np.round(one.force, digits).any():
            continue
        vector = ", ".join(f"{round(value, digits) + 0.0:.{_DIGITS}g}" for value in one.force)
        part = " on the modelled part" if one.kind == "symmetry" else ""
        yield f"{one.kind} {one.name!r}: force ({vector}){_unit(r, 'force')}{part}{_moved(r, motion)}"


def _moved(r: StepRecord, motion: float | list[float] | None) -> str:
    """The closing of a section, or the motion of a rigid face."""
    if motion is None:
        return ""
    if not isinstance(motion, list):
        return f", closed by {motion:.5g}{_unit(r, 'length')}"
    shift, turn = (", ".join(f"{value:.5g}" for value in part) for part in (motion[:3], motion[3:]))
    return f", moved by ({shift}){_unit(r, 'length')}, turned by ({turn}) rad"


def undirected(record: StepRecord) -> Iterator[str]:
    """Lines on the contact pairs whose sum of magnitudes is more than the length of their force vector."""
    pairs = [one for one in record.resultants or () if one.kind == "contact"]
    for pair, force, alignment in zip(pairs, record.pair_forces, record.pair_alignments or ()):
        if alignment is not None and alignment < DIRECTED and force > _ROUNDING * max(record.pair_forces):
            vector = ", ".join(f"{0.0 if abs(value) < _ROUNDING * force else value:.5g}" for value in pair.force)
            yield (
                f"{pair.name!r} presses in many directions: its forces add up to ({vector}), {alignment:.1%} of the "
                "sum of their magnitudes"
            )


def _unit(r: StepRecord, quantity: str) -> str:
    """Unit of a quantity behind a number, if it is known."""
    return f" {unit_of(quantity, r.units)}".rstrip()
