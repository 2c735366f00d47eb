"""The figures of one adaptive step, a line of `steps.jsonl`."""

from dataclasses import asdict, dataclass, fields, is_dataclass
from typing import get_args, get_type_hints

from fx_contact.forest.partition_quality import PartitionSummary


class Record:
    """A frozen dataclass of a step's figures, to and from JSON."""

    def as_json(self):
        """The entries, without the optional ones that are not known: dict.  Local."""
        entries = asdict(self)
        return {one.name: entries[one.name] for one in fields(self) if entries[one.name] is not one.default}

    @classmethod
    def from_json(cls, entries):
        """A record from the entries of a JSON object, those of other versions left out.

        Local.

        Args:
            entries: dict, as `json.loads` makes it of a line of `steps.jsonl`.

        Raises:
            TypeError: it is no dict, or lacks an entry.
        """
        return _from_entries(cls, entries)


def _from_entries(kind, entries):
    """An instance of a dataclass from the entries that it knows, nested dataclasses likewise."""
    if not isinstance(entries, dict):
        raise TypeError(f"{kind.__name__} needs a JSON object, got {entries!r}")
    known = {}
    for name, hint in get_type_hints(kind).items():
        if name in entries:
            nested = [one for one in (hint, *get_args(hint)) if is_dataclass(one)]
            known[name] = _from_entries(nested[0], entries[name]) if nested else entries[name]
    return kind(**known)


@dataclass(frozen=True)
class TrueError:
    """What an over-refined solution u_fine says about a step.

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


@dataclass(frozen=True)
class StepRecord(Record):
    """The figures of one adaptive step, alike on all ranks.

    Forces, contact radius and pressure are those of the whole bodies, whatever symmetry is used.  Units are those of
    the scene, here SI.

    Attributes:
        scene: name of the scene.
        step: number of the step, from 0.
        ranks: number of MPI ranks.
        cells: leaves of the forest.
        dofs: conforming degrees of freedom.
        degree: of the elements.
        hanging_nodes: nodes without degrees of freedom of their own.
        max_level: finest level of a leaf; root cells have level 0.
        geometry_order: polynomial order of the leaf maps.
        enforcement: `Enforcement.method`.
        control: `ErrorControl.mode`.
        active_pairs: closed node pairs.
        force: sum of `pair_forces` [N].
        pair_forces: normal contact force of each contact pair [N].
        contact_radius: radius of the circular contact with this distribution of forces [m].
        max_pressure: largest nodal pressure [Pa].
        max_penetration: largest overlap of a node pair [m].
        contact_iterations: of the active set.
        krylov_iterations: of PCG, for each solve.
        preconditioner: as asked for, or the one that took its place.
        estimate: estimated relative error in the energy norm, xi / omega [-].
        assumed_effectivity: measured effectivity of the estimate, 1 where it is not known to be less [-].
        tolerance: prescribed relative error e in the energy norm [-].
        ratio: xi / (e omega), (6) [-].
        pair_errors: estimated error of each pair's force, relative to the force, or for an open pair to the force that
            closing it would take; None where nothing is known [-].
        pair_leaves: leaves marked for the force of each contact pair.
        unseen_contact: leaves marked because the surfaces touch between their nodes; None: not asked for.
        penalty_share: largest share of a pair's contact energy that its penetration takes [-]; None: not asked for.
        reached: whether the tolerance is reached.
        partition: PartitionSummary.
        seconds: wall time by stage (`timing.STAGES`) and `total`, the maximum over ranks [s].
        cpu_seconds: CPU time by stage and `total`, the sum over ranks [s].
        memory_bytes: resident memory at the end of each stage, the sum over ranks [bytes].
        peak_memory_bytes: largest resident memory, the sum over ranks [bytes].
        versions: of the libraries, by name.
        errors: deviations from known values by name, relative to them [-]; None: nothing is known.
        true_error: TrueError, or None if it was not measured.
        effectivity: estimate over true error [-], or None.
    """

    scene: str
    step: int
    ranks: int
    cells: int
    dofs: int
    degree: int
    hanging_nodes: int
    max_level: int
    geometry_order: int
    enforcement: str
    control: str
    active_pairs: int
    force: float
    pair_forces: list[float]
    contact_radius: float
    max_pressure: float
    max_penetration: float
    contact_iterations: int
    krylov_iterations: list[int]
    preconditioner: str
    estimate: float
    assumed_effectivity: float
    tolerance: float
    ratio: float
    pair_errors: list[float | None]
    pair_leaves: list[int]
    unseen_contact: int | None
    penalty_share: float | None
    reached: bool
    partition: PartitionSummary
    seconds: dict[str, float]
    cpu_seconds: dict[str, float]
    memory_bytes: dict[str, float]
    peak_memory_bytes: int
    versions: dict[str, str]
    errors: dict[str, float] | None = None
    true_error: TrueError | None = None
    effectivity: float | None = None
