"""One adaptive step: the solution on a given forest, its estimated error, and the record of both."""

from dataclasses import asdict, dataclass
from functools import cached_property
from numbers import Integral

import numpy as np
from mpi4py import MPI

from fx_contact.adaptive.step_record import StepRecord
from fx_contact.contact.constraint_rows import resultants
from fx_contact.contact.contact_problem import ContactProblem, Environment, SolveOptions
from fx_contact.contact.contact_solver import solve_system
from fx_contact.contact.enforcement import Enforcement
from fx_contact.contact.initial_guess import RigidMotions
from fx_contact.contact.node_pairs import create_node_pairs
from fx_contact.estimate.contact_goals import ContactError, contact_error
from fx_contact.estimate.dual_weighted import Goals
from fx_contact.estimate.equilibrium import check_balance
from fx_contact.estimate.error_control import ErrorControl
from fx_contact.estimate.recovery import Recovery
from fx_contact.estimate.solved_state import SolvedState
from fx_contact.fem.dirichlet import prescribed_displacements, shear_free_components
from fx_contact.fem.elasticity import Elasticity
from fx_contact.fem.external_forces import load
from fx_contact.fem.leaf_mesh import create_leaf_mesh, sufficient_order
from fx_contact.forest.forest import Forest
from fx_contact.linalg.petsc_objects import PetscObjects
from fx_contact.linalg.solver_options import Solver
from fx_contact.parallel.errors import SceneError, SolveError
from fx_contact.parallel.timing import Stages
from fx_contact.parallel.validation import check_number, shown
from fx_contact.parallel.versions import library_versions
from fx_contact.problem.fingerprint import scene_parts
from fx_contact.problem.scene import Scene, check_scene

#: Degree of the displacements.
DEGREE = 1
#: Share of the prescribed error that the leaf maps may deviate from the root cells' maps, relative to the leaf's size,
#: where the program chooses the geometry order.
GEOMETRY_SHARE = 0.1
#: Energy norms of bodies without contact that are so many times what rounding leaves are those of rigid motions.
RIGID = 1e3
#: Smallest tolerance: below it rounding is most of the error, on any mesh that fits into a memory.
LEAST_TOLERANCE = 1e-9
#: The most of the prescribed error that linear solver and rounding may use up.
SOLVER_SHARE = 0.1


def check_tolerance(what, value):
    """A prescribed error as a float.  Raises SceneError unless it is a positive number, and rounding lets it be met."""
    tolerance = check_number(what, value, positive=True)
    if tolerance < LEAST_TOLERANCE:
        raise SceneError(
            f"{what} must be at least {LEAST_TOLERANCE:g}, got {tolerance:g}: below that rounding is most of the "
            "error, so that no mesh reaches it"
        )
    return tolerance


@dataclass(frozen=True, eq=False)
class Settings:
    """What is asked of every step of a run.

    Attributes:
        scene: Scene.
        tolerance: prescribed relative error e in the energy norm, (6) [-].
        geometry_order: order of the leaf maps; None: the lowest that holds the root map to `GEOMETRY_SHARE` times the
            tolerance.
        enforcement: Enforcement of the contact conditions.
        solver: Solver.
        control: ErrorControl.

    Raises:
        SceneError: a value of another type, a tolerance below `LEAST_TOLERANCE` or not below 1, an order above
            that of the root mesh.
    """

    scene: Scene
    tolerance: float
    geometry_order: int | None
    enforcement: Enforcement
    solver: Solver
    control: ErrorControl

    def __post_init__(self):
        check_scene(self.scene)
        tolerance = check_tolerance("the tolerance", self.tolerance)
        object.__setattr__(self, "tolerance", tolerance)
        order, orders = self.geometry_order, range(1, self.scene.mesh.order + 1)
        if tolerance >= 1:
            raise SceneError(f"the tolerance is relative and must be below 1, got {tolerance}: 4 % are 0.04")
        for name, kind in (("enforcement", Enforcement), ("solver", Solver), ("control", ErrorControl)):
            if not isinstance(getattr(self, name), kind):
                raise SceneError(f"{name} must be a {kind.__name__}, got {shown(getattr(self, name))}")
        if order is None:
            return
        if isinstance(order, bool) or not isinstance(order, Integral) or order not in orders:
            raise SceneError(
                f"the geometry order must be 1 to {orders[-1]}, that of the root mesh, got {shown(order)}"
            )
        object.__setattr__(self, "geometry_order", int(order))

    @cached_property
    def problem(self):
        """`fingerprint.scene_parts` of the scene; only the first time, functions of the user are called.

        Local.
        """
        return scene_parts(self.scene)

    def asked(self):
        """All of it as JSON can hold it, by name: dict.  Local."""
        return {
            "scene": self.scene.name,
            **self.problem,
            "tolerance": self.tolerance,
            "geometry order": self.geometry_order,
            "enforcement": asdict(self.enforcement),
            "error control": asdict(self.control),
            **{f"solver's {name}": value for name, value in vars(self.solver).items() if name != "options"},
            **{f"solver's option {name}": value for name, value in self.solver.options.items()},
        }


@dataclass(frozen=True, eq=False)
class Step:
    """The state after one adaptive step.

    Attributes:
        record: StepRecord.
        scene: Scene.
        forest: Forest.
        leaf_mesh: LeafMesh.
        elasticity: Elasticity; its `u` is the displacement.
        pairs: NodePairs or None.
        start: (owned, 3) float64, displacement carried from the step before, where the solve began [m].
        solution: ContactSolution.
        estimate: Estimate.
        history: RefinementHistory, with what this step has shown.
        contact_error: ContactError.
        stages: Stages of this step, from the refinement that led to it.
        along: (n, (p+1)^3, k) float64 at the nodes of the leaves, further fields that go along.
    """

    record: StepRecord
    scene: object
    forest: Forest
    leaf_mesh: object
    elasticity: Elasticity
    pairs: object
    start: np.ndarray
    solution: object
    estimate: object
    history: object
    contact_error: ContactError
    stages: Stages
    along: np.ndarray

    def __del__(self):
        # Where steps are collected and a later one fails, Python drops them while the error is under way; communicators
        # of dolfinx freed then hang in mpi4py (see `_mpi`).  Inside `__del__` the error is set aside.
        self.__dict__.clear()

    @property
    def nodal_displacement(self):
        """Displacement at the nodes of this rank's leaves: (n, (p+1)^3, 3) [m].  Collective."""
        prolongation = self.elasticity.prolongation
        return prolongation.prolong(self.solution.displacement)[prolongation.space.cells]


def check_step(step, contact=False):
    """See that a value is a Step, and has contact if asked for.  Local.

    Args:
        step: what the user gave.
        contact: whether the scene must have contact pairs.

    Raises:
        SceneError: it is none, or the scene has none.
    """
    if not isinstance(step, Step):
        raise SceneError(f"a Step is needed, as adapt yields them, got {shown(step)}")
    if contact and step.pairs is None:
        raise SceneError(f"the scene {step.scene.name!r} has no contact pairs, of which to show something")


def solve_step(settings, number, forest, prolongation, start, along, stages, quality, history):
    """Solve on a forest and estimate the error.

    Collective on forest.comm.

    Args:
        settings: Settings.
        number: of the step.
        forest: Forest.
        prolongation: Prolongation of the forest.
        start: (owned, 3) float64, first guess of the displacement [m].
        along: (n, (p+1)^3, k) float64, fields that go along.
        stages: Stages, with the times so far.
        quality: PartitionSummary.
        history: RefinementHistory of the run so far.

    Returns:
        Step.

    Raises:
        SolveError: the solve fails, or is not as accurate as the tolerance needs.
    """
    scene, tolerance, control, comm = settings.scene, settings.tolerance, settings.control, forest.comm
    with stages("mesh"):
        order = settings.geometry_order or sufficient_order(forest, GEOMETRY_SHARE * tolerance)
        cells = create_leaf_mesh(forest, order)
    with stages("assemble"):
        materials = np.array([[m.young, m.poisson] for m in (scene.materials[b] for b in scene.mesh.bodies)])
        elasticity = Elasticity(cells, materials, scene.mesh.body[forest.cell[cells.leaf]], prolongation, stages)
        pairs = create_node_pairs(scene, forest, prolongation, settings.enforcement) if scene.contact else None
    with stages("system"):
        prescribed = prescribed_displacements(scene, forest, prolongation)
        forces = load(scene, forest, elasticity)
        rest = not comm.allreduce(bool(start.any()), op=MPI.LOR)
        motions = RigidMotions(scene, forest, prolongation) if rest and scene.contact else None
    with stages("assemble"):
        matrix = elasticity.stiffness(pairs)
    with PetscObjects(matrix.mat) as objects:
        problem = ContactProblem(matrix, forces, prescribed, elasticity.energy_norm, pairs, scene, motions)
        options = SolveOptions(settings.solver, settings.enforcement)
        contact, system = solve_system(problem, start, options, Environment(stages, objects))
        with stages("estimate"):
            change = elasticity.change_norm(contact.displacement - start) if control.of_contact else None
            elasticity.set_displacement(contact.displacement)
            recovery = Recovery(elasticity, shear_free_components(scene, forest, prolongation), stages)
            touches = comm.allreduce(bool(contact.force.any()), op=MPI.LOR)
            error = recovery.estimate(0.0 if touches else RIGID * contact.rounding)
            _check_solver(contact, error, tolerance)
            state = SolvedState(scene, forest, elasticity, pairs, contact, error)
            if error.energy_norm:
                check_balance(state, forces, prescribed)
            if control.of_contact:
                history = history.observed(error, change, control.least_effectivity)
            results = _contact_results(scene, pairs, contact, comm)
            of_contact = ContactError.unknown(len(forest), len(scene.contact))
            if pairs is not None and control.of_contact:
                goals = Goals(state, system, recovery, stages)
                of_contact = contact_error(state, goals, results["pair_forces"], tolerance, control, history)
            max_level = comm.allreduce(int(forest.level.max(initial=0)), op=MPI.MAX)
    fine = control.sought(error, tolerance, history) is None and not of_contact.leaves
    record = StepRecord(
        scene=scene.name,
        step=number,
        ranks=comm.size,
        cells=forest.size_global,
        dofs=3 * prolongation.index_map.size_global,
        degree=prolongation.space.degree,
        hanging_nodes=prolongation.hanging_global,
        max_level=max_level,
        geometry_order=order,
        enforcement=settings.enforcement.method,
        control=control.mode,
        **results,
        contact_iterations=contact.contact_iterations,
        krylov_iterations=contact.krylov_iterations,
        preconditioner=contact.preconditioner,
        estimate=error.relative,
        assumed_effectivity=control.effectivity(history),
        tolerance=tolerance,
        ratio=error.relative / tolerance,
        pair_errors=of_contact.of_pairs,
        pair_leaves=of_contact.leaves_of_pairs,
        unseen_contact=of_contact.unseen,
        penalty_share=of_contact.penalty_share,
        reached=bool(fine and (of_contact.penalty_share or 0.0) <= tolerance**2),
        partition=quality,
        **stages.costs(comm),
        versions=library_versions(),
    )
    return Step(
        record, scene, forest, cells, elasticity, pairs, start, contact, error, history, of_contact, stages, along
    )


def _check_solver(contact, error, tolerance):
    """See that the linear solver's error is small against that prescribed.  Local.

    Raises:
        SolveError: it is not.
    """
    if contact.energy_error > SOLVER_SHARE * tolerance * error.energy_norm > 0:
        raise SolveError(
            f"linear solver and rounding leave {contact.energy_error / error.energy_norm:.1%} of the energy norm open, "
            f"and the tolerance is {tolerance:.1%}: take a smaller tolerance of the solver, a less stiff penalty, or "
            "let the bodies begin closer to each other, whose rigid motions are large against their strains"
        )


def _contact_results(scene, pairs, contact, comm):
    """Force, radius, pressure and penetration of the whole bodies, whatever symmetry was used."""
    if pairs is None:
        return dict(
            active_pairs=0, force=0.0, pair_forces=[], contact_radius=0.0, max_pressure=0.0, max_penetration=0.0
        )
    force = resultants(scene, pairs, contact.force)
    arm = pairs.position - scene.contact_centre
    radius2 = (arm**2).sum(axis=1) - np.einsum("ni,ni->n", arm, pairs.normal) ** 2
    total, moment, active = comm.allreduce(np.array([force.sum(), force @ radius2, contact.active.sum()]), op=MPI.SUM)
    of_pair = np.bincount(pairs.contact, weights=force, minlength=len(scene.contact)).astype(float)
    comm.Allreduce(MPI.IN_PLACE, of_pair)
    pressure = comm.allreduce(float((contact.force / pairs.area).max(initial=0.0)), op=MPI.MAX)
    return {
        "active_pairs": int(active),
        "force": float(total * scene.symmetry),
        "pair_forces": (of_pair * scene.symmetry).tolist(),
        "contact_radius": float(np.sqrt(2.5 * moment / total)) if total else 0.0,
        "max_pressure": pressure,
        "max_penetration": comm.allreduce(float(contact.penetration.max(initial=0.0)), op=MPI.MAX),
    }
