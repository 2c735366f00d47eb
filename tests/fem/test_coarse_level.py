"""The coarse level of p-multigrid: interpolation, Galerkin product, preconditioner, options."""

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import DISTRIBUTIONS, conforming_positions, discrete, grown, pressed, roots, two_boxes
from petsc4py import PETSc

from fx_contact import SceneError, Solver, adapt
from fx_contact.fem.coarse_level import create_coarse_level
from fx_contact.fem.dirichlet import find_supports
from fx_contact.fem.supports import Supports
from fx_contact.linalg.krylov import ConjugateGradients
from fx_contact.linalg.operator import MatrixOperator
from fx_contact.linalg.petsc_objects import PetscObjects, PetscOptions
from fx_contact.linalg.solver_options import preconditioner_options

pytestmark = pytest.mark.ranks(1, 2, 3)


@pytest.fixture(params=list(DISTRIBUTIONS))
def problem(request):
    """Two boxes of affine cells with hanging nodes: scene, forest, and elasticity of degree 2."""
    scene = pressed(two_boxes(distortion=0.0))
    forest = DISTRIBUTIONS[request.param](grown(roots(scene), 2, share=0.15))
    elasticity = discrete(scene, forest, degree=2)
    assert elasticity.prolongation.hanging_global > 0
    return scene, forest, elasticity


def free(elasticity):
    """Nothing prescribed."""
    return Supports(np.full((elasticity.prolongation.owned, 3), np.nan))


def aij(matrix):
    """A matrix of dolfinx's blocks, assembled, as AIJ."""
    matrix.assemble()
    return matrix.convert(PETSc.Mat.Type.AIJ)


def test_coarse_matrix_is_the_galerkin_product(problem):
    """I^T K I is the matrix of degree 1 on the same leaves."""
    *_, elasticity = problem
    coarse = create_coarse_level(elasticity, free(elasticity))
    product = aij(elasticity.stiffness().mat).ptap(coarse.interpolation)
    assert product.norm() > 1
    assert (product - coarse.matrix).norm() < 1e-12 * product.norm()


def test_prescribed_components_are_not_interpolated(problem):
    """Neither to those of degree 2 nor from those of degree 1; the others are what they are without."""
    scene, forest, elasticity = problem
    supports = find_supports(scene, forest, elasticity.prolongation)
    held = create_coarse_level(elasticity, supports).interpolation
    x, y = held.createVecs()
    x.set(1.0)
    held.mult(x, y)
    position, _ = conforming_positions(forest, elasticity.prolongation)
    fixed = ~supports.free
    assert WORLD.allreduce(int(fixed.sum())) > 50
    moved, near = y.array.reshape(-1, 3), np.minimum(np.abs(position[:, 2] + 1), np.abs(position[:, 2] - 2)) < 1
    everywhere((moved[fixed] == 0).all(), "a prescribed component moves")
    everywhere(np.abs(moved[~near] - 1).max(initial=0) < 1e-13, "free components do not")
    assert (
        WORLD.allreduce(int((moved[near & ~fixed.any(axis=1)] < 0.75).sum())) > 50
    ), "held nodes move their neighbours"


def test_preconditioner_is_symmetric_and_positive(problem):
    """x . M^-1 y = y . M^-1 x and x . M^-1 x > 0, as conjugate gradients need it."""
    scene, forest, elasticity = problem
    supports = find_supports(scene, forest, elasticity.prolongation)
    matrix, coarse = elasticity.stiffness().mat, create_coarse_level(elasticity, supports)
    matrix.assemble()
    rows = matrix.getOwnershipRange()[0] + np.flatnonzero(~supports.free.ravel()).astype(PETSc.IntType)
    matrix.zeroRowsColumns(rows, diag=1.0)
    with PetscObjects(matrix, coarse) as objects:
        options = PetscOptions(WORLD, "fx_", preconditioner_options("p-multigrid", matrix.getSize()[0]), {})
        operator = MatrixOperator(matrix, objects)
        method = ConjugateGradients(options, operator, matrix, elasticity.energy_norm, objects)
        method.set_up(coarse)
        preconditioner = method.preconditioner
        assert preconditioner.pc.getType() == "mg"
        x, y, of_x, of_y = (matrix.createVecLeft() for _ in range(4))
        position, _ = conforming_positions(forest, elasticity.prolongation)
        for wave in (0.1, 3.0, 40.0):
            x.array[:], y.array[:] = np.sin(wave * position).ravel(), np.cos(wave * position[:, ::-1] ** 2).ravel()
            preconditioner.pc.apply(x, of_x)
            preconditioner.pc.apply(y, of_y)
            size = np.sqrt(x.dot(of_x) * y.dot(of_y))
            assert size > 0
            assert abs(x.dot(of_y) - y.dot(of_x)) < 1e-11 * size


def iterations(**options):
    """PCG iterations of a step of degree 2."""
    scene = pressed(two_boxes(upper=(3, 3, 3), depth=2, order=2, bend=0.1))
    (step,) = adapt(scene, 0.9, degree=2, max_steps=1, solver=Solver(**options))
    assert step.record.dofs > 1000
    return step.record.preconditioner, step.record.krylov_iterations[-1]


def test_options_of_the_levels():
    """Options of the user replace those of both levels; misspelt ones are an error."""
    name, count = iterations()
    assert name == "p-multigrid" and 5 < count < 30
    assert iterations(options={"mg_levels_ksp_max_it": 5})[1] < count
    assert iterations(options={"mg_levels_pc_type": "sor"})[1] < count, "not of the whole matrix"
    assert iterations(options={"mg_coarse_pc_type": "jacobi", "mg_coarse_ksp_type": "preonly"})[1] > 1.5 * count
    with pytest.raises(SceneError, match="mg_levels_ksp_maxit"):
        iterations(options={"mg_levels_ksp_maxit": 5})


def test_p_multigrid_is_for_degree_two():
    """At degree 1 there is no coarse level."""
    with pytest.raises(SceneError, match="'p-multigrid'.*degree 2.*'boomeramg'"):
        next(adapt(pressed(two_boxes()), 0.9, degree=1, solver=Solver("p-multigrid")))
