"""Operators and their sums: products, diagonals, residuals, and solvers that know nothing else of a stiffness."""

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import DISTRIBUTIONS, conforming_positions, discrete, grown, pressed, roots, two_boxes

from fx_contact import Enforcement, Material
from fx_contact.contact.jump import Jump
from fx_contact.contact.penalty_term import PenaltyTerm, reserve
from fx_contact.contact.row_kinds import create_rows
from fx_contact.fem.dirichlet import find_supports
from fx_contact.linalg.krylov import ConjugateGradients
from fx_contact.linalg.operator import Equations, MatrixOperator, Operator, Sum
from fx_contact.linalg.petsc_objects import PetscObjects, PetscOptions


@pytest.fixture(params=list(DISTRIBUTIONS))
def problem(request):
    """Stiffness with room for contact, its volume term, and a penalty term; a displacement."""
    scene = pressed(two_boxes(margin=1), materials=(Material(1.0, 0.3), Material(2.0, 0.49)))
    forest = DISTRIBUTIONS[request.param](grown(roots(scene), 2, share=0.2))
    elasticity = discrete(scene, forest, degree=2)
    supports = find_supports(scene, forest, elasticity.prolongation)
    pairs = create_rows(scene, elasticity.prolongation, Enforcement())
    jump, matrix = Jump(pairs, supports), elasticity.stiffness(pairs, mixed=True, supports=supports).mat
    reserve(matrix, jump)
    matrix.assemble()
    assert WORLD.allreduce(len(pairs)) > 9
    position, _ = conforming_positions(forest, elasticity.prolongation)
    u = np.ascontiguousarray(np.sin(3 * position + [0.0, 1.0, 2.0]))
    stiffness = 1.0 + np.arange(len(pairs))
    with PetscObjects(matrix) as objects:
        yield MatrixOperator(matrix, objects), elasticity.volume_term(supports), PenaltyTerm(jump, stiffness), u


def product(operator, u):
    """The product with an operator."""
    y = np.zeros_like(u)
    operator.add_product(u, y)
    return y


def test_terms_of_a_sum_add_up(problem):
    """Products and diagonals are added, also to what is there; None is no term."""
    *operators, u = problem
    for some in (operators[:1], operators[1:], [*operators, None]):
        whole, terms = Sum(some), [term for term in some if term is not None]
        everywhere(np.allclose(product(whole, u), sum(product(term, u) for term in terms), atol=1e-14), "product")
        everywhere(np.allclose(whole.diagonal(), sum(term.diagonal() for term in terms), atol=1e-14), "diagonal")
    y = u.copy()
    whole.add_product(u, y)
    everywhere(np.allclose(y - u, product(whole, u), atol=1e-12), "not added")


def test_a_penalty_term_beside_a_matrix_is_that_in_the_matrix(problem):
    """Its product, and its diagonal."""
    matrix, _, penalty, u = problem
    beside = Sum([matrix, penalty])
    expected, diagonal = product(beside, u), beside.diagonal()
    assert np.abs(penalty.diagonal()).max(initial=0) > 0 or WORLD.size > 1
    penalty.add_to(matrix.mat)
    size = WORLD.allreduce(float(np.abs(expected).max(initial=0.0)))
    everywhere(np.abs(product(matrix, u) - expected).max(initial=0.0) < 1e-13 * size, "another product")
    everywhere(np.abs(matrix.diagonal() - diagonal).max(initial=0.0) < 1e-13 * size, "another diagonal")


def test_residual(problem):
    """b + B^T k D - (K + B^T k B) u."""
    matrix, _, penalty, u = problem
    load = np.cos(u)
    expected = load + penalty.load() - product(Sum([matrix, penalty]), u)
    everywhere(np.allclose(Equations(load, penalty).residual(matrix, u), expected, atol=1e-12), "with a term")
    everywhere(np.allclose(Equations(load).residual(matrix, u), load - product(matrix, u), atol=1e-14), "without")


def test_a_krylov_method_takes_any_operator(problem):
    """PCG solves with an operator of its own class; the preconditioner has the matrix alone."""
    matrix, _, penalty, exact = problem
    bedding = matrix.diagonal()

    class Stiffness(Operator):
        """A matrix, a penalty, and springs to the ground at each node."""

        def add_product(self, u, y):
            """The three of them."""
            matrix.add_product(u, y)
            penalty.add_product(u, y)
            y += bedding * u

        def diagonal(self):
            """Of the matrix and the springs."""
            return 2 * bedding

    stiffness = Stiffness()

    def energy_norm(u):
        return WORLD.allreduce(float((u * product(stiffness, u)).sum())) ** 0.5

    load = product(stiffness, exact)
    with PetscObjects() as objects:
        options = PetscOptions(WORLD, "any_", {"pc_type": "jacobi"}, {})
        method = ConjugateGradients(options, stiffness, matrix.mat, energy_norm, objects)
        method.set_up(None)
        outcome = method.solve(Equations(load), np.zeros_like(load), 1e-8, 500)
    assert outcome.reason > 0
    assert energy_norm(outcome.displacement - exact) < 1e-6 * energy_norm(exact)
