"""The contact problem with an operator of its own beside the preconditioner's matrix."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import EXACT, discrete, pressed, roots, solved, strewn, two_boxes, with_rows
from mpi4py import MPI

from fx_contact import Enforcement, Material
from fx_contact.contact.contact_problem import ContactProblem, SolveOptions
from fx_contact.contact.enforcement import METHODS
from fx_contact.law.contact_solver import solve_contact
from fx_contact.linalg.operator import MatrixOperator
from fx_contact.linalg.petsc_objects import PetscObjects
from fx_contact.parallel.timing import Stages


@pytest.mark.parametrize("method", METHODS)
def test_operator_beside_a_matrix(method):
    """The solution is that of the operator; the matrix of other moduli only preconditions."""
    scene, enforcement = pressed(two_boxes()), Enforcement(method)
    forest = strewn(roots(scene))
    elasticity, rows, supports = with_rows(scene, forest, enforcement)
    expected = solved(elasticity, rows, supports, enforcement)
    other = discrete(replace(scene, materials=dict.fromkeys(scene.materials, Material(3.0, 0.1))), forest)
    held = elasticity.stiffness(rows, supports=supports).held
    with PetscObjects() as objects:
        stiffness = objects.add(elasticity.stiffness(supports=supports).mat)
        stiffness.assemble()
        problem = ContactProblem(
            replace(other.stiffness(rows, supports=supports), held=held),
            np.zeros_like(supports.prescribed),
            supports,
            elasticity.energy_norm,
            rows,
            operator=MatrixOperator(stiffness, objects),
        )
        found = solve_contact(problem, np.zeros_like(supports.prescribed), SolveOptions(EXACT, enforcement), Stages())
    scale = WORLD.allreduce(expected.force.max(initial=0.0), MPI.MAX)
    assert scale > 0
    everywhere(np.abs(found.displacement - expected.displacement).max(initial=0.0) < 1e-10, "other displacements")
    everywhere((found.active == expected.active).all(), "other rows are closed")
    everywhere(np.abs(found.force - expected.force).max(initial=0.0) <= 1e-8 * scale, "other forces")
