"""The figures of one adaptive step, a line of `steps.jsonl`."""

from dataclasses import asdict, dataclass, field, fields

from mpi4py import MPI

from fx_contact.adaptive.resultants import Resultant
from fx_contact.adaptive.validity import Doubt
from fx_contact.estimate.goal_errors import GoalRecord
from fx_contact.forest.partition_quality import PartitionSummary
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.versions import library_versions


@dataclass(frozen=True, kw_only=True)
class SolveRecord:
    """What every solve on an adaptive mesh records, alike on all ranks.

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
    memory_bytes: dict[str, float]
    peak_memory_bytes: int
    versions: dict[str, str]

    @classmethod
    @collective("elasticity.prolongation.comm")
    def of(cls, elasticity, solution, estimate, tolerance, stages, **further):
        """The record of a solve.

        Collective.

        Args:
            elasticity: Elasticity.
            solution: ContactSolution.
            estimate: Estimate.
            tolerance: prescribed relative error [-].
            stages: Stages of the step so far.
            further: the other entries.
        """
        prolongation, forest = elasticity.prolongation, elasticity.prolongation.space.forest
        return cls(
            ranks=forest.comm.size,
            cells=forest.size_global,
            dofs=3 * prolongation.index_map.size_global,
            degree=prolongation.space.degree,
            hanging_nodes=prolongation.hanging_global,
            max_level=forest.comm.allreduce(int(forest.level.max(initial=0)), op=MPI.MAX),
            geometry_order=elasticity.leaf_mesh.order,
            krylov_iterations=solution.krylov_iterations,
            estimate=estimate.relative,
            tolerance=tolerance,
            ratio=estimate.relative / tolerance,
            versions=library_versions(),
            **stages.costs(forest.comm),
            **further,
        )

    def as_json(self):
        """The entries, without the optional ones that are not known: dict.  Local."""
        entries = asdict(self)
        return {one.name: entries[one.name] for one in fields(self) if entries[one.name] is not one.default}


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


@dataclass(frozen=True, kw_only=True)
class StepRecord(SolveRecord):
    """The figures of one adaptive step.

    Forces, contact radius and pressure are those of the whole bodies, whatever symmetry is used.  Units are those of
    the scene, here SI.

    Attributes:
        enforcement: `Enforcement.method`.
        control: `ErrorControl.mode`.
        active_pairs: closed node pairs.
        force: sum of `pair_forces` [N].
        pair_forces: normal contact force of each contact pair [N].
        contact_radius: radius of Hertz's contact with these second moments of the forces about `contact_centre` [m];
            None where they differ across the contact, or take more than the closed area (a flat punch), or where
            several pairs press; 0 where nothing touches.
        max_pressure: largest nodal pressure [Pa].
        max_penetration: largest penetration of a node pair [m].
        contact_iterations: of the active set.
        preconditioner: as asked for, or the one that took its place.
        assumed_effectivity: measured effectivity of the estimate, 1 where it is not known to be less [-].
        pair_errors: estimated error of each pair's force, that of a goal `ContactForce`, relative to the force; None
            where it is 0 or nothing is known [-].
        pair_leaves: leaves marked for the force of each contact pair.
        unseen_contact: leaves marked because the surfaces touch between their nodes; None: not asked for.
        penalty_share: largest share of a pair's force that the penetration of a penalty takes [-]; None: not computed,
            before the energy error meets the tolerance.
        reached: whether the tolerance is reached.
        partition: PartitionSummary.
        doubts: list of Doubt, what speaks against the problem itself, however small its error.
        errors: deviations from known values by name, relative to them [-]; None: nothing is known.
        true_error: TrueError, or None if it was not measured.
        effectivity: estimate over true error [-], or None.
        contact_centre: (3,) `Scene.contact_centre`, or the centroid of the contact forces; where there are none the
            middle of the bodies [m].
        pair_alignments: length of the sum of each pair's forces over the sum of their lengths [-], 1 where they are
            parallel; None: the pair is open.
        goals: tuple of GoalRecord, of the goals of the run; None: it has none.
        resultants: tuple of Resultant, of contact pairs, loads, conditions, and the balance of each body.
    """

    enforcement: str
    control: str
    active_pairs: int
    force: float
    pair_forces: list[float]
    contact_radius: float | None
    max_pressure: float
    max_penetration: float
    contact_iterations: int
    preconditioner: str
    assumed_effectivity: float
    pair_errors: list[float | None]
    pair_leaves: list[int]
    unseen_contact: int | None
    penalty_share: float | None
    reached: bool
    partition: PartitionSummary
    doubts: list[Doubt] = field(default_factory=list)
    errors: dict[str, float] | None = None
    true_error: TrueError | None = None
    effectivity: float | None = None
    contact_centre: list[float] | None = None
    pair_alignments: list[float | None] | None = None
    resultants: tuple[Resultant, ...] | None = None
    goals: tuple[GoalRecord, ...] | None = None

    @classmethod
    def from_json(cls, entries):
        """A record from a line of `steps.jsonl`; entries of other versions are left out.

        Local.

        Args:
            entries: dict, as `json.loads` makes it of the line.

        Raises:
            TypeError: it is no dict, or lacks an entry.
        """
        known = {one.name: entries[one.name] for one in fields(cls) if one.name in entries}
        for name, kind in (("partition", PartitionSummary), ("true_error", TrueError)):
            if name in known:
                known[name] = kind(**known[name])
        if "resultants" in known:
            known["resultants"] = tuple(map(Resultant.from_json, known["resultants"]))
        known["doubts"] = [Doubt.from_json(doubt) for doubt in known.get("doubts", ())]
        if known.get("goals") is not None:
            known["goals"] = tuple(GoalRecord(**goal) for goal in known["goals"])
        return cls(**known)
