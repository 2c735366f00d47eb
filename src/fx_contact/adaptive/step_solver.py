"""One adaptive step: discretise on a given forest, solve, judge, and write down what came out."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from fx_contact.adaptive.contact_figures import figures_of_contact
from fx_contact.adaptive.resultants import sum_up
from fx_contact.adaptive.settings import GEOMETRY_SHARE
from fx_contact.adaptive.step import Step
from fx_contact.adaptive.step_record import StepRecord
from fx_contact.adaptive.validity import Doubt, check_doubts, find_doubts
from fx_contact.contact.contact_problem import ContactProblem, SolveOptions
from fx_contact.contact.contact_solver import solve_system
from fx_contact.contact.initial_guess import RigidModes
from fx_contact.contact.row_kinds import create_rows
from fx_contact.estimate.contact_goals import ContactError, contact_error, force_goals
from fx_contact.estimate.dual_weighted import Goals
from fx_contact.estimate.effectivity import RefinementHistory
from fx_contact.estimate.equilibrium import WHERE_ROUNDING_IS_LARGE, check_balance, nodal_residual
from fx_contact.estimate.estimator import Estimate, Estimator
from fx_contact.estimate.goal_errors import judge_goals
from fx_contact.estimate.shear_free import find_shear_free
from fx_contact.estimate.solved_state import SolvedState
from fx_contact.fem.coarse_level import create_coarse_level
from fx_contact.fem.dirichlet import find_supports
from fx_contact.fem.displacement_field import DisplacementField
from fx_contact.fem.elasticity import Elasticity
from fx_contact.fem.external_forces import body_force, load_and_totals
from fx_contact.fem.leaf_mesh import LeafMesh, create_leaf_mesh, sufficient_order
from fx_contact.fem.prolongation import Prolongation
from fx_contact.linalg.petsc_objects import PetscObjects
from fx_contact.parallel.errors import SolveError
from fx_contact.parallel.validation import percent

#: Without contact, an energy norm up to this many times rounding is that of a rigid motion: taken as 0.  Half-spheres
#: that do not touch, moved by 1e-6 to 1 of their radius, have 0.3 to 0.8 times rounding
#: (`test_bodies_that_do_not_touch`).
RIGID = 1e3
#: The most of the prescribed error that linear solver and rounding may use up: errors add in squares, and a tenth adds
#: 0.5 % of it.
SOLVER_SHARE = 0.1


@dataclass(frozen=True, eq=False)
class StepStart:
    """Where the solve of a step starts.

    Attributes:
        prolongation: Prolongation of the space.
        displacement: (owned, 3) float64, first guess [m].
        along: (n, (p+1)^3, k) float64, fields that go along.
        history: RefinementHistory of the run so far.
    """

    prolongation: Prolongation
    displacement: np.ndarray
    along: np.ndarray
    history: RefinementHistory

    @property
    def forest(self):
        """Forest of the space."""
        return self.prolongation.space.forest


class _Discrete(NamedTuple):
    """The discrete problem."""

    leaf_mesh: LeafMesh
    elasticity: Elasticity
    problem: ContactProblem
    load_totals: np.ndarray


class _Verdict(NamedTuple):
    """What is known of a solution: its error, its contact as a whole, and what is doubtful."""

    field: DisplacementField
    estimate: Estimate
    history: RefinementHistory
    contact_error: ContactError
    contact: dict
    doubts: list[Doubt]
    reached: bool


def solve_step(settings, number, start, partition, stages):
    """Solve on a forest and estimate the error.

    Collective on the forest's communicator.

    Args:
        settings: Settings.
        number: of the step.
        start: StepStart.
        partition: PartitionSummary.
        stages: Stages, with the times so far.

    Returns:
        Step.

    Raises:
        SolveError: the solve fails, or is not as accurate as the tolerance needs.
        ValidityError: the solution is far outside of what linear elasticity is valid for.
    """
    discrete = _discretise(settings, start, stages)
    with PetscObjects(discrete.problem.matrix.mat, discrete.problem.coarse) as objects:
        options = SolveOptions(settings.solver, settings.enforcement)
        solution, system = solve_system(discrete.problem, start.displacement, options, stages, objects)
        with stages("estimate"):
            verdict = _judge(settings, start, discrete, solution, system, stages)
    return Step(
        record=_record(settings, discrete, solution, verdict, stages, step=number, partition=partition),
        scene=settings.scene,
        forest=start.forest,
        leaf_mesh=discrete.leaf_mesh,
        elasticity=discrete.elasticity,
        field=verdict.field,
        pairs=discrete.problem.rows,
        start=start.displacement,
        solution=solution,
        estimate=verdict.estimate,
        history=verdict.history,
        contact_error=verdict.contact_error,
        stages=stages,
        along=start.along,
    )


def _discretise(settings, start, stages):
    """Mesh, stiffness, conditions, forces and rows of contact of a step: _Discrete.  Collective."""
    scene, forest, prolongation = settings.scene, start.forest, start.prolongation
    with stages("mesh"):
        order = settings.geometry_order or sufficient_order(forest, GEOMETRY_SHARE * settings.tolerance)
        mesh = create_leaf_mesh(forest, order)
    with stages("assemble"):
        materials = np.array([[m.young, m.poisson] for m in (scene.materials[b] for b in scene.mesh.bodies)])
        elasticity = Elasticity(mesh, materials, scene.mesh.body[forest.cell[mesh.leaf]], prolongation, stages)
        pairs = create_rows(scene, prolongation, settings.enforcement) if scene.contact else None
    with stages("system"):
        supports = find_supports(scene, forest, prolongation)
        forces, totals = load_and_totals(scene, forest, elasticity)
        rest = not forest.comm.allreduce(bool(start.displacement.any()), op=MPI.LOR)
        motions = RigidModes(scene, forest, prolongation) if rest and scene.contact else None
    with stages("assemble"):
        mixed = elasticity.mixed and settings.solver.preconditioner != "cholesky"  # factors take all of K
        matrix = elasticity.stiffness(pairs, not settings.multigrid, mixed, supports)
        coarse = create_coarse_level(elasticity, supports) if settings.multigrid else None
        volume = elasticity.volume_term(supports) if mixed else None
    problem = ContactProblem(
        matrix=matrix,
        load=forces,
        supports=supports,
        energy_norm=elasticity.energy_norm,
        rows=pairs,
        scene=scene,
        motions=motions,
        coarse=coarse,
        volume=volume,
    )
    return _Discrete(mesh, elasticity, problem, totals)


def _judge(settings, start, discrete, solution, system, stages):
    """Estimate the error of a solution, of contact too where it is asked for: _Verdict.  Collective.

    Raises:
        SolveError: the linear solver or equilibrium are off by more than the tolerance allows.
        ValidityError: the solution is far outside of what linear elasticity is valid for.
    """
    scene, tolerance, control = settings.scene, settings.tolerance, settings.control
    forest, elasticity, problem = start.forest, discrete.elasticity, discrete.problem
    pairs, history, comm = problem.rows, start.history, forest.comm
    change = elasticity.change_norm(solution.displacement - start.displacement) if control.of_contact else None
    shear_free = find_shear_free(scene, forest, start.prolongation)
    estimator = Estimator(elasticity, shear_free, stages, body_force(scene, elasticity))
    touches = comm.allreduce(bool(solution.force.any()), op=MPI.LOR)
    field = elasticity.field(solution.displacement)
    error = estimator.error(field, 0.0 if touches else RIGID * solution.rounding)
    estimate = error.estimate
    _check_solver(solution, estimate, tolerance)
    state = SolvedState(scene, forest, elasticity, field, pairs, solution, estimate)
    residual = nodal_residual(state, problem.load)
    if estimate.energy_norm:
        check_balance(state, residual, problem.load, problem.supports)
    doubts = find_doubts(state, discrete.load_totals)
    check_doubts(doubts, settings.allow)
    if control.of_contact:
        history = history.observed(estimate, change, control.least_effectivity)
    contact = figures_of_contact(scene, pairs, solution, comm)
    contact["resultants"] = sum_up(state, residual, discrete.load_totals, contact["contact_centre"])
    contact["contact_centre"] = contact["contact_centre"].tolist()
    met, forces = control.sought(estimate, tolerance, history) is None, {}
    duals = Goals(state, error, estimator, system, stages)
    of_contact = ContactError.unknown(len(forest), len(scene.contact))
    if pairs is not None and control.of_contact:
        forces = force_goals([pair.name for pair in scene.contact], contact["pair_forces"], tolerance)
    goals, theta = (*forces.values(), *settings.goals), control.correction(history)
    judged = judge_goals(goals, duals if met else None, state, residual, theta, control)
    if pairs is not None and control.of_contact:
        of_contact = contact_error(state, duals.between, dict(zip(forces, judged)))
    if settings.goals:
        of_users = judged[len(forces) :]
        contact["goals"] = tuple(goal.record for goal in of_users)
        of_contact = of_contact.with_more(of_users, comm)
    fine = met and not of_contact.leaves
    reached = bool(fine and (of_contact.penalty_share or 0.0) <= tolerance**2)
    return _Verdict(field, estimate, history, of_contact, contact, doubts, reached)


def _record(settings, discrete, solution, verdict, stages, **known):
    """The StepRecord of a step, of which some entries are known.  Collective."""
    of_contact = verdict.contact_error
    return StepRecord.of(
        discrete.elasticity,
        solution,
        verdict.estimate,
        settings.tolerance,
        stages,
        scene=settings.scene.name,
        enforcement=settings.enforcement.method,
        control=settings.control.mode,
        contact_iterations=solution.contact_iterations,
        preconditioner=solution.preconditioner,
        assumed_effectivity=settings.control.effectivity(verdict.history),
        pair_errors=of_contact.of_pairs,
        pair_leaves=of_contact.leaves_of_pairs,
        unseen_contact=of_contact.between_nodes,
        penalty_share=of_contact.penalty_share,
        reached=verdict.reached,
        doubts=verdict.doubts,
        **verdict.contact,
        **known,
    )


def _check_solver(contact, error, tolerance):
    """See that the linear solver's error is small against that prescribed.  Local.

    Raises:
        SolveError: it is not.
    """
    if contact.energy_error > SOLVER_SHARE * tolerance * error.energy_norm > 0:
        raise SolveError(
            f"linear solver and rounding leave {percent(contact.energy_error / error.energy_norm)} of the energy norm "
            f"open, and the tolerance is {percent(tolerance)}: take a smaller tolerance of the solver or a less "
            f"stiff penalty; {WHERE_ROUNDING_IS_LARGE}"
        )
