"""The mixed form of nearly incompressible bodies: the same solutions, an error that is what is said, few iterations."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import EXACT, STEEL, discrete, grown, pressed, roots, strewn, two_boxes
from petsc4py import PETSc

from fx_contact import (
    ContactPair,
    Dirichlet,
    Enforcement,
    Material,
    RigidCylinder,
    Scene,
    SceneError,
    Solver,
    SymmetryPlane,
    adapt,
    block,
    root_mesh_from_shapes,
    solve,
)
from fx_contact.contact.contact_problem import ContactProblem, SolveOptions
from fx_contact.contact.row_kinds import create_rows
from fx_contact.fem.coarse_level import create_coarse_level
from fx_contact.fem.dirichlet import find_supports
from fx_contact.fem.sum_factorisation import matrix_free
from fx_contact.law.contact_solver import solve_contact, solve_system
from fx_contact.linalg import ladder
from fx_contact.linalg.mixed_form import FlexibleGmres
from fx_contact.linalg.operator import MatrixOperator, PressureOperator
from fx_contact.linalg.petsc_objects import PetscObjects, PetscOptions
from fx_contact.parallel.errors import SolveError
from fx_contact.parallel.timing import Stages
from fx_contact.scenes import hertz

DIRECT = replace(EXACT, preconditioner="cholesky")


class Problem:
    """Two boxes in contact, the upper one of rubber, of degree 2 with hanging nodes, leaves strewn over the ranks."""

    def __init__(self, poisson):
        self.scene = pressed(two_boxes(), materials=(STEEL, Material(1.0, poisson)))
        self.forest = strewn(grown(roots(self.scene), 2, share=0.15))
        self.elasticity = discrete(self.scene, self.forest, degree=2)
        self.prolongation = self.elasticity.prolongation
        self.supports = find_supports(self.scene, self.forest, self.prolongation)

    def problem(self, mixed, enforcement):
        """ContactProblem, in the mixed form or with the whole stiffness assembled."""
        rows = create_rows(self.scene, self.prolongation, enforcement)
        return ContactProblem(
            matrix=matrix_free(self.elasticity, rows, mixed, self.supports),
            load=np.zeros_like(self.supports.prescribed),
            supports=self.supports,
            energy_norm=self.elasticity.energy_norm,
            rows=rows,
            coarse=create_coarse_level(self.elasticity, self.supports),
            volume=self.elasticity.volume_term(self.supports) if mixed else None,
        )

    def solution(self, mixed, solver=EXACT, enforcement=Enforcement()):
        """ContactSolution, by the mixed form or by PCG."""
        problem, options = self.problem(mixed, enforcement), SolveOptions(solver, enforcement)
        return solve_contact(problem, np.zeros_like(self.supports.prescribed), options, Stages())


@pytest.mark.parametrize(
    "how",
    [Enforcement(), Enforcement("penalty", 10.0), Enforcement("penalty", 1e8)],
    ids=["exact", "penalty", "stiff penalty"],
)
def test_same_solution_as_without_pressures(how):
    """Displacement and contact forces are those of PCG on the whole stiffness, however contact is enforced."""
    problem = Problem(0.49)
    one, other = (problem.solution(mixed, enforcement=how) for mixed in (True, False))
    size = problem.elasticity.energy_norm(other.displacement)
    assert size > 0 and WORLD.allreduce(int(other.active.sum())) > 3
    everywhere((one.active == other.active).all(), "another active set")
    assert problem.elasticity.energy_norm(one.displacement - other.displacement) < 1e-8 * size
    most = WORLD.allreduce(float(other.force.sum()))
    everywhere(np.abs(one.force - other.force).max(initial=0) < 1e-7 * most, "other contact forces")
    assert max(one.krylov_iterations) < max(other.krylov_iterations)


@pytest.mark.parametrize("how", [Enforcement(), Enforcement("penalty", 1e4)], ids=["exact", "penalty"])
def test_factors_are_those_of_the_whole_stiffness(how, monkeypatch):
    """They may take over in the middle of a contact problem, and leave PCG on the stiffness itself."""
    monkeypatch.setattr(ladder, "patience", lambda *_: 5)
    problem = Problem(0.49999)
    chosen, by_user = (problem.solution(mixed, solver, how) for mixed, solver in ((True, EXACT), (False, DIRECT)))
    size = problem.elasticity.energy_norm(by_user.displacement)
    assert (chosen.preconditioner, by_user.preconditioner) == ("cholesky", "cholesky")
    assert problem.elasticity.energy_norm(chosen.displacement - by_user.displacement) < 1e-8 * size


@pytest.mark.parametrize("poisson", [0.45, 0.49999])
def test_error_is_what_is_said(poisson):
    """The error in the energy norm is below the bound that ends the iteration, and of its size."""
    problem = Problem(poisson)
    exact = problem.solution(True).displacement
    rough = problem.solution(True, Solver(tolerance=1e-4, loose_tolerance=1e-3))
    error = problem.elasticity.energy_norm(rough.displacement - exact)
    assert 0.02 * rough.energy_error < error < 1.5 * rough.energy_error  # M is A up to a factor of 2 or so
    assert abs(rough.energy_error / (1e-4 * problem.elasticity.energy_norm(exact)) - 1) < 1e-3


class Weights(PressureOperator):
    """C of two pressures, without D."""

    comm, missing, schur = WORLD, np.array([2.0, 3.0]), np.ones(2)

    def diagonal(self):
        """None of its own."""
        return np.zeros((2, 3))

    strains = forces = add_to = None


def test_bound_is_of_both_residuals():
    """(f . M^-1 f)^(1/2) + (q . C q)^(1/2) of all ranks, with a diagonal M."""
    matrix = PETSc.Mat().createAIJ(((6, None), (6, None)), bsize=3, nnz=1, comm=WORLD)
    diagonal = matrix.createVecRight()
    diagonal.array[:] = 4.0
    matrix.setDiagonal(diagonal)
    matrix.assemble()
    forces, strains = 1.0 + np.arange(6).reshape(2, 3) + WORLD.rank, np.array([7.0, 8.0]) + WORLD.rank
    with PetscObjects(matrix, diagonal) as objects:
        options = PetscOptions(WORLD, "bound_", {"pc_type": "jacobi"}, {})
        method = FlexibleGmres(options, MatrixOperator(matrix, objects), matrix, lambda u: 1.0, objects, Weights())
        method.set_up(None)
        bound = method._bound(method._scaled(forces.copy(), strains))
    squares = WORLD.allreduce(np.array([(forces**2).sum() / 4.0, Weights.missing @ strains**2]))
    assert abs(bound / np.sqrt(squares).sum() - 1) < 1e-14


def test_iterations_hardly_depend_on_poisson():
    """Twice as many as for steel at most, to the same relative error; forces tend to a limit."""
    last, force = {}, {}
    for poisson in (0.3, 0.499, 0.49999, 0.4999999):
        step = solve(hertz(material=Material(1.0, poisson), coarse=2), 0.2, solver=Solver("p-multigrid"))
        last[poisson], force[poisson] = step.record.krylov_iterations[-1], step.record.force
        assert step.record.preconditioner == "p-multigrid"
    assert max(last.values()) <= 2 * last[0.3], last
    # F is linear in 1 - 2 nu near the limit.
    slope = (force[0.499] - force[0.49999]) / (0.49999 - 0.499)
    assert abs(force[0.4999999] - force[0.49999] + slope * (0.4999999 - 0.49999)) < 1e-5 * force[0.49999]


def test_pressures_of_the_last_solutions_begin_the_next():
    """An obstacle settles below a force by solutions and derivatives at four places, two of three known before."""
    ball = ContactPair("pad top", RigidCylinder((0, 0, 2), (0, 1, 0), 1), force=(0, 0, -0.008))
    mesh = root_mesh_from_shapes({"pad": block((0, 0, 0), (2, 2, 1), (2, 2, 1), 1)})
    held = Dirichlet("pad bottom", z=0.0), SymmetryPlane("pad left"), SymmetryPlane("pad front")
    scene = Scene("rubber", mesh, {"pad": Material(1.0, 0.4999)}, held, contact=ball)
    iterations = solve(scene, 0.9, max_steps=1).record.krylov_iterations
    assert len(iterations) == 9 and iterations.count(0) >= 3, iterations


def test_pressures_of_rubber_have_no_checkerboard():
    """Contact pressures lie along Hertz's profile through the force, p0 (1 - r^2/a^2)^(1/2), at every node."""
    step = solve(hertz(material=Material(1.0, 0.4999), order=6, coarse=2), 0.05)
    table = step.contact.gathered()
    if WORLD.rank == 0:
        modulus = 0.5 / (1 - 0.4999**2)
        a = (3 * step.record.force * 0.5 / (4 * modulus)) ** (1 / 3)
        p0 = 1.5 * step.record.force / (np.pi * a**2)
        r = np.hypot(*table.points[:, :2].T) / a
        inside = r < 0.8
        assert inside.sum() > 20
        assert np.abs(table.pressure[inside] / p0 - np.sqrt(1 - r[inside] ** 2)).max() < 0.04


def test_adjoint_problems_start_from_nothing():
    """An adjoint of a gap has no displacement to start with, and no energy to which its tolerance could be relative."""
    problem = Problem(0.49)
    options, load = SolveOptions(Solver()), np.zeros_like(problem.supports.prescribed)
    load[:, 2] = 1.0
    with PetscObjects() as objects:
        whole = problem.problem(True, Enforcement())
        _, system = solve_system(whole, np.zeros_like(load), options, Stages(), objects)
        dual, _ = system.dual(load, np.zeros(len(whole.rows)), 1e-6)
    assert problem.elasticity.energy_norm(dual) > 1.0
    assert system.solver.iterations[-1] < 50, system.solver.iterations


def test_options_are_those_of_fgmres():
    """Conjugate gradients cannot be asked for where the system is not definite."""
    scene = hertz(material=Material(1.0, 0.49), order=2, coarse=2)
    with pytest.raises(SolveError, match="must be one of fgmres"):
        next(adapt(scene, 0.5, solver=Solver(options={"ksp_type": "cg"})))
    with pytest.raises(SceneError, match="misspelt"):
        next(adapt(scene, 0.5, solver=Solver(options={"ksp_gmres_modifiedgramschmitt": 1})))
