"""One adaptive step: discretise on a given forest, solve, estimate the errors, record."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI

from fx_contact.adaptive.settings import GEOMETRY_SHARE, Settings
from fx_contact.adaptive.solve_record import record_of_solve
from fx_contact.adaptive.step import Step
from fx_contact.adaptive.step_record import Motions, StepRecord
from fx_contact.contact.constraint_rows import ConstraintRows, Role
from fx_contact.contact.contact_problem import ContactProblem, History, SolveOptions
from fx_contact.contact.contact_system import ContactSystem, LinearSystem
from fx_contact.contact.row_kinds import columns_at_rest, create_rows
from fx_contact.estimate.contact_edge import cells_at_edge
from fx_contact.estimate.contact_goals import ContactError, contact_error, force_goals
from fx_contact.estimate.dual_weighted import Goals
from fx_contact.estimate.equilibrium import WHERE_ROUNDING_IS_LARGE, check_balance, nodal_residual
from fx_contact.estimate.estimator import Estimator
from fx_contact.estimate.goal_errors import GoalRecord, judge_goals
from fx_contact.estimate.shear_free import find_shear_free
from fx_contact.estimate.solved_state import SolvedState
from fx_contact.fem.body_motions import BodyMotions
from fx_contact.fem.coarse_level import create_coarse_level
from fx_contact.fem.dirichlet import find_supports
from fx_contact.fem.elasticity import Elasticity
from fx_contact.fem.external_forces import body_force, load_and_totals
from fx_contact.fem.leaf_mesh import LeafMesh, create_leaf_mesh, sufficient_order
from fx_contact.fem.nodal_fields import NodalFields
from fx_contact.fem.nodal_strain import sum_at_nodes
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.springs import Springs
from fx_contact.fem.sum_factorisation import energy_norm, matrix_free
from fx_contact.forest.forest import Forest
from fx_contact.forest.partition_quality import PartitionSummary
from fx_contact.law.contact_solver import ContactSolution, solve_system
from fx_contact.law.settling import RowsAt, touching
from fx_contact.linalg.petsc_objects import PetscObjects
from fx_contact.parallel.arrays import FloatArray, IntArray
from fx_contact.parallel.errors import SolveError
from fx_contact.parallel.timing import Stages
from fx_contact.parallel.validation import percent
from fx_contact.scene.scene import Scene
from fx_contact.verdict.contact_figures import ContactFigures, figures_of_contact
from fx_contact.verdict.model_warning import ModelWarning, check_model_warnings
from fx_contact.verdict.penetration import penetrations
from fx_contact.verdict.resultants import Resultant, sum_up, unbalanced_moments
from fx_contact.verdict.solution_warnings import load_warnings, warnings_of_state

#: Energy norms up to this many times rounding are those of rigid motions; 0.3 to 0.8 are (`tests/scenes/test_hertz`).
RIGID = 1e3
#: Largest part of the prescribed error for linear solver and rounding: errors add in squares, and a tenth adds 0.5 %.
SOLVER_SHARE = 0.1
#: Name of the field with the displacement of the point before, in a load path of increments.
HISTORY = "history"


@dataclass(frozen=True, eq=False)
class StepStart:
    """Start of the solve of a step.

    Attributes:
        displacement: (owned, 3), first guess [m].
        fields: further fields at the nodes of the leaves.
        effectivity: assumed of the estimate, as `ErrorControl.effectivity`.
        motions: `StepRecord.motions` of the step before, if it is known.
        expected: `StepRecord.expected_estimate`.
    """

    prolongation: Prolongation
    displacement: FloatArray
    fields: NodalFields
    effectivity: float
    motions: Mapping[str, Any] | None = None
    expected: float | None = None

    @property
    def forest(self) -> Forest:
        """Forest of the space."""
        return self.prolongation.space.forest

    @property
    def history_displacement(self) -> FloatArray | None:
        """Displacement (owned, 3) [m] of the point before in a load path of increments; None: the first.  Local."""
        space, known = self.prolongation.space, HISTORY in self.fields
        return self.prolongation.injected(self.fields.at_nodes(space, HISTORY)) if known else None


class _Discrete(NamedTuple):
    """The discrete problem, its external forces (owned, 3) [N] and their totals as from `load_and_totals`."""

    elasticity: Elasticity
    problem: ContactProblem
    external: FloatArray
    load_totals: FloatArray


class _Assessment(NamedTuple):
    """A solution with its errors, its contact, and violated assumptions."""

    state: SolvedState
    contact_error: ContactError
    goals: tuple[GoalRecord, ...]
    figures: ContactFigures
    resultants: tuple[Resultant, ...]
    warnings: list[ModelWarning]
    reached: bool


def solve_step(
    settings: Settings, number: int, start: StepStart, partition: PartitionSummary, stages: Stages
) -> Step:
    """Solve on a forest and estimate the error.

    Collective on start.forest.comm.

    Args:
        number: of the step.
        stages: with the times so far.

    Raises:
        SolveError: the solve fails, or is not as accurate as the tolerance needs.
        ValidityError: the solution is far outside of linear elasticity.
    """
    discrete = _discretise(settings, start, stages)
    with PetscObjects(discrete.problem.matrix.mat, discrete.problem.coarse) as objects:
        options = SolveOptions(settings.solver, settings.enforcement)
        solution, system = solve_system(discrete.problem, start.displacement, options, stages, objects)
        with stages("estimate"):
            assessed = _assess(
                settings, start, discrete, *_estimate(settings, start, discrete, solution, system, stages)
            )
    state, of_contact = assessed.state, assessed.contact_error
    solve = record_of_solve(
        settings.scene.name, number, state.elasticity, solution, state.estimate, settings.tolerance, stages
    )
    record = StepRecord(
        **vars(solve),
        **vars(assessed.figures),
        enforcement=settings.enforcement.method,
        control=settings.control.mode,
        contact_iterations=solution.contact_iterations,
        preconditioner=solution.preconditioner,
        assumed_effectivity=start.effectivity,
        expected_estimate=start.expected,
        pair_errors=of_contact.pair_errors,
        pair_leaves=of_contact.pair_leaves,
        penetrated_leaves=of_contact.penetrated_leaves,
        penalty_share=of_contact.penalty_share,
        reached=assessed.reached,
        partition=partition,
        doubts=assessed.warnings,
        resultants=assessed.resultants,
        goals=assessed.goals,
        motions=Motions(solution.motions),
        free_motions=solution.free_motions or None,
        remote_rows=0 if solution.rows is None else solution.rows.remote,
        yielded_rows=solution.yielded_rows,
        units=settings.scene.units,
    )
    return Step(
        **vars(state),
        record=record,
        start=start.displacement,
        contact_error=of_contact,
        stages=stages,
        fields=start.fields,
    )


def _discretise(settings: Settings, start: StepStart, stages: Stages) -> _Discrete:
    """Mesh, stiffness, conditions, forces and rows of contact of a step.  Collective."""
    scene, forest = settings.scene, start.forest
    with stages("mesh"):
        order = settings.geometry_order or sufficient_order(forest, GEOMETRY_SHARE * settings.tolerance)
        mesh = create_leaf_mesh(forest, order)
    with stages("assemble"):
        rows, rows_at, distances = _rows(settings, start)
        prolongation = start.prolongation if rows is None else rows.prolongation
        elasticity = elasticity_of(scene, mesh, forest.cell[mesh.leaf], prolongation, stages)
    with stages("system"):
        supports = find_supports(scene, forest, prolongation)
        forces, totals = load_and_totals(scene, forest, elasticity)
    with stages("assemble"):
        mixed = elasticity.mixed and settings.solver.preconditioner != "cholesky"  # factors take all of K
        coarse = create_coarse_level(elasticity, supports) if settings.multigrid else None
        entries = coarse is None or coarse.blocks is not None  # factors, hypre and blocks of nodes need them
        matrix = (Elasticity.stiffness if entries else matrix_free)(elasticity, rows, mixed, supports)
        volume = elasticity.volume_term(supports) if mixed else None
    problem = ContactProblem(
        matrix=matrix,
        load=forces + elasticity.stress_free_forces() if scene.strains else forces,
        supports=supports,
        energy_norm=energy_norm(elasticity, matrix, volume),
        rows=rows,
        bodies=BodyMotions(scene, elasticity, supports),
        coarse=coarse,
        volume=volume,
        rows_at=rows_at,
        before=History(start.history_displacement, settings.moved_before),
        distances=distances,
    )
    return _Discrete(elasticity, problem, forces, totals)


def elasticity_of(
    scene: Scene, mesh: LeafMesh, cells: IntArray, prolongation: Prolongation, stages: Stages
) -> Elasticity:
    """Elasticity of a scene on a mesh, with the root cells (n,) of its cells.  Collective."""
    materials = [scene.materials[name] for name in scene.mesh.regions]
    layer = scene.layers[cells], int(scene.layers.max()) + 1
    strain = sum_at_nodes(scene.strains, prolongation.space, mesh, (3, 3)) if scene.strains else None
    springs = Springs(scene.springs, prolongation, mesh.order) if scene.springs else None
    return Elasticity(mesh, materials, scene.mesh.region[cells], prolongation, stages, layer, springs, strain)


def _rows(settings: Settings, start: StepStart) -> tuple[ConstraintRows | None, RowsAt | None, FloatArray]:
    """Rows of contact, and of obstacles below forces as in `ContactProblem`: where they were before, or touch.

    Collective.
    """
    scene, enforcement = settings.scene, settings.enforcement
    moved = [pair.name for pair in scene.contact if pair.motion is not None]
    if not moved:
        rows = create_rows(scene, start.prolongation, enforcement) if scene.interfaces else None
        return rows, None, np.zeros(0)
    known = columns_at_rest(scene, start.prolongation, enforcement)

    def rows_at(distances: FloatArray) -> ConstraintRows:
        """Rows with obstacles moved along the forces on them.  Collective."""
        there = scene.approached(dict(zip(moved, map(float, distances))))
        return create_rows(there, start.prolongation, enforcement, known)

    before = start.motions or {}
    if all(name in before for name in moved):
        distances = np.array([before[name] for name in moved], dtype=np.float64)
    else:
        distances = touching(rows_at, len(moved), start.displacement)
    return rows_at(distances), rows_at, distances


def _assess(
    settings: Settings, start: StepStart, discrete: _Discrete, state: SolvedState, duals: Goals
) -> _Assessment:
    """Errors and figures of a solution, checked.  Collective.

    Raises:
        SolveError: the linear solver or equilibrium are off by more than the tolerance allows.
        ValidityError: the solution is far outside of linear elasticity.
    """
    tolerance, control, theta = settings.tolerance, settings.control, start.effectivity
    _check_solver(state, tolerance)
    residual = _checked_residual(state, discrete)
    warnings = load_warnings(state.scene) if HISTORY not in start.fields else []  # a last increment may have none
    figures = figures_of_contact(state.scene, state.rows, state.solution, state.forest.comm)
    resultants = sum_up(state, residual, discrete.load_totals, np.array(figures.contact_centre))
    warnings += [*warnings_of_state(state, discrete.load_totals), *penetrations(state), *settings.scene_warnings]
    warnings += unbalanced_moments(state.scene, resultants)
    check_model_warnings(warnings, (*settings.allow, "no load"))  # refused at the beginning
    met = control.sought(state.estimate, tolerance, theta) is None
    holds_contact = state.rows is not None and control.of_contact
    pair_forces = figures.pair_forces if holds_contact else ()
    forces = force_goals([pair.name for pair in state.scene.contact], pair_forces, tolerance)
    goals = *forces.values(), *settings.goals
    # Errors that need adjoint solutions are computed once the tolerance is met.
    judged = judge_goals(goals, duals if met else None, state, residual, theta, control)
    of_user = judged[len(forces) :]
    of_contact = contact_error(state, duals.between if holds_contact else None, dict(zip(forces, judged)), of_user)
    reached = met and not of_contact.leaves and (of_contact.penalty_share or 0.0) <= tolerance**2
    known = tuple(goal.record for goal in of_user)
    return _Assessment(state, of_contact, known, figures, resultants, warnings, bool(reached))


def _estimate(
    settings: Settings,
    start: StepStart,
    discrete: _Discrete,
    solution: ContactSolution,
    system: ContactSystem | LinearSystem,
    stages: Stages,
) -> tuple[SolvedState, Goals]:
    """Solution with its estimated error, and the adjoint problems of its goals.  Collective."""
    scene, forest, elasticity = settings.scene, start.forest, discrete.elasticity
    shear_free = find_shear_free(scene, forest, elasticity.prolongation)
    estimator = Estimator(elasticity, shear_free, stages, body_force(scene, elasticity))
    touches = not solution.free_motions and forest.comm.allreduce(bool(solution.force.any()), op=MPI.LOR)
    field = elasticity.field(solution.displacement, loaded=True)
    # Stresses below the tolerance of those of full restraint count as 0: bodies that expand freely have none.
    least = settings.tolerance * elasticity.restraint_norm()
    error = estimator.error(field, 0.0 if touches else RIGID * solution.rounding, least=least)
    rows = solution.rows.part(Role.NORMAL) if solution.rows is not None and scene.contact else None
    state = SolvedState(scene, forest, elasticity, field, rows, solution, error.estimate)
    if rows is not None:
        state = replace(state, estimate=replace(error.estimate, at_edge=cells_at_edge(state)))
    return state, Goals(state, error, estimator, system, stages, bounds=not settings.goals)


def _check_solver(state: SolvedState, tolerance: float) -> None:
    """Raises SolveError unless the linear solver's error is small against that prescribed.  Local."""
    left, norm = state.solution.energy_error, state.estimate.energy_norm
    if left > SOLVER_SHARE * tolerance * norm > 0:
        raise SolveError(
            f"linear solver and rounding leave {percent(left / norm)} of the energy norm open, and the tolerance is "
            f"{percent(tolerance)}: take a smaller tolerance of the solver or a less stiff penalty; "
            f"{WHERE_ROUNDING_IS_LARGE}"
        )


def _checked_residual(state: SolvedState, discrete: _Discrete) -> FloatArray:
    """`nodal_residual`, in balance.  Collective.  Raises SolveError."""
    residual = nodal_residual(state, discrete.external)
    if state.estimate.energy_norm:
        check_balance(state, residual, discrete.problem.load, discrete.problem.supports)
    return residual
