"""The figures of one adaptive step, a line of `steps.jsonl`."""

import warnings
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Self

from mpi4py import MPI

from fx_contact.adaptive.step_report import costs, report_text
from fx_contact.estimate.estimator import Estimate
from fx_contact.estimate.goal_errors import GoalRecord
from fx_contact.fem.elasticity import Elasticity
from fx_contact.forest.partition_quality import PartitionSummary
from fx_contact.items.units import Units
from fx_contact.law.contact_solver import ContactSolution
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.timing import Stages
from fx_contact.parallel.versions import library_versions
from fx_contact.verdict.contact_figures import ContactFigures
from fx_contact.verdict.model_warning import ModelWarning
from fx_contact.verdict.resultants import Resultant


@dataclass(frozen=True, kw_only=True)
class SolveRecord:
    """The figures of a solve on an adaptive mesh, alike on all ranks.

    Attributes:
        scene: its name.
        step: number of the step, from 0.
        ranks: number of MPI ranks.
        cells: leaves of the forest.
        dofs: conforming degrees of freedom.
        degree: of the displacements.
        hanging_nodes: nodes without degrees of freedom of their own.
        max_level: finest level of a leaf; root cells have level 0.
        geometry_order: polynomial order of the leaf maps.
        krylov_iterations: of PCG, for each solve.
        estimate: estimated relative error in the energy norm, xi / omega [-].
        tolerance: prescribed relative error e in the energy norm [-].
        ratio: xi / (e omega), (6) [-].
        seconds: wall time by stage (`timing.STAGES`) and `total`, the maximum over ranks [s].
        cpu_seconds: CPU time by stage and `total`, the sum over ranks [s].
        memory_bytes: resident memory at the end of each stage, the sum over ranks [bytes].
        peak_memory_bytes: largest resident memory, the sum over ranks [bytes].
        versions: of the libraries, by name.
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
    krylov_iterations: list[int]
    estimate: float
    tolerance: float
    ratio: float
    seconds: dict[str, float]
    cpu_seconds: dict[str, float]
    memory_bytes: dict[str, int]
    peak_memory_bytes: int
    versions: dict[str, str | None]

    def as_json(self) -> dict[str, Any]:
        """The entries, without optional ones that are not known.  Local."""
        entries = asdict(self)
        return {one.name: entries[one.name] for one in fields(self) if entries[one.name] is not one.default}


@collective("elasticity.prolongation.comm")
def record_of_solve(
    scene: str,
    step: int,
    elasticity: Elasticity,
    solution: ContactSolution,
    estimate: Estimate,
    tolerance: float,
    stages: Stages,
) -> SolveRecord:
    """The record of a solve, with the costs of its stages so far.  Collective."""
    prolongation, forest = elasticity.prolongation, elasticity.prolongation.space.forest
    return SolveRecord(
        scene=scene,
        step=step,
        ranks=forest.comm.size,
        cells=forest.size_global,
        dofs=3 * prolongation.index_map.size_global,
        degree=int(prolongation.space.degree),
        hanging_nodes=prolongation.hanging_global,
        max_level=forest.comm.allreduce(int(forest.level.max(initial=0)), op=MPI.MAX),
        geometry_order=elasticity.leaf_mesh.order,
        krylov_iterations=solution.krylov_iterations,
        estimate=estimate.relative,
        tolerance=tolerance,
        ratio=estimate.relative / tolerance,
        versions=library_versions(),
        **stages.costs(forest.comm),
    )


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


@dataclass(frozen=True, kw_only=True)
class StepRecord(SolveRecord, ContactFigures):
    """The figures of one adaptive step, with those of `SolveRecord` and `ContactFigures`; `print` shows a report.

    Units are those of the scene, here SI.

    Attributes:
        enforcement: `Enforcement.method`.
        control: `ErrorControl.mode`.
        contact_iterations: of the active set.
        preconditioner: the chosen one, or its replacement.
        assumed_effectivity: of the estimate: `ErrorControl.least_effectivity` on a first mesh, else 1 [-].
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
        approaches: for each contact pair, then each tie, how far its obstacle has moved from `moved` along the force on
            it, or its section has closed [m], or None; then for each rigid load the motion of its surface, three
            translations [m] and rotations [rad] about its point; None: there is none of them.
        remote_rows: number of rows of contact and ties with nodes of other ranks.
        units: names of those of length and stress, as `Scene.units`.
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
    approaches: list[Any] | None = None
    remote_rows: int = 0
    units: Units = None

    def __str__(self) -> str:
        return f"{report_text(self)}\n  {costs(self)}"

    @property
    def unseen_contact(self) -> int | None:
        """Former name of `penetrated_leaves`."""
        warnings.warn("unseen_contact is now penetrated_leaves", DeprecationWarning, stacklevel=2)
        return self.penetrated_leaves

    @classmethod
    def from_json(cls, entries: dict[str, Any]) -> Self:
        """A record from a line of `steps.jsonl`; entries of other versions are left out.

        Local.

        Raises:
            TypeError: the entries are no dict, or lack one.
        """
        entries = {_FORMER.get(name, name): value for name, value in entries.items()}
        if entries.get("goals", ()) is None:  # before goals were a list in each record
            del entries["goals"]
        known = {one.name: entries[one.name] for one in fields(cls) if one.name in entries}
        for name, kind in _KINDS.items():
            value = known.get(name)
            if isinstance(value, dict):
                known[name] = kind(**value)
            elif value is not None:
                rows = [{n: tuple(v) if isinstance(v, list) else v for n, v in row.items()} for row in value]
                known[name] = (list if name == "doubts" else tuple)(kind(**row) for row in rows)
        if known.get("units") is not None:
            known["units"] = tuple(known["units"])
        return cls(**known)


#: Former names of entries.
_FORMER = {"unseen_contact": "penetrated_leaves"}
#: Classes of entries that are objects or lists of them.
_KINDS: dict[str, type] = {
    "partition": PartitionSummary,
    "true_error": TrueError,
    "doubts": ModelWarning,
    "resultants": Resultant,
    "goals": GoalRecord,
}
