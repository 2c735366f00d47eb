"""The figures of a solve on an adaptive mesh."""

from dataclasses import asdict, dataclass, fields
from typing import Any

from mpi4py import MPI

from fx_contact.estimate.estimator import Estimate
from fx_contact.fem.elasticity import Elasticity
from fx_contact.law.contact_solver import ContactSolution
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.timing import Stages
from fx_contact.parallel.versions import library_versions


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
