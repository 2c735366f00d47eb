"""The balance of each body, of solutions that are spoilt by a known amount."""

from dataclasses import replace

import numpy as np
import pytest
from model_problems import EXACT

from fx_contact import Material, adapt
from fx_contact.estimate.equilibrium import check_balance, nodal_residual, unbalanced
from fx_contact.estimate.solved_state import SolvedState
from fx_contact.fem.dirichlet import find_supports
from fx_contact.parallel.errors import SolveError
from fx_contact.scenes import stack


@pytest.fixture(scope="module")
def solution():
    """Two cubes pressed together, of nu = 0, as `unbalanced` takes them, but for the contact forces' factor."""
    scene = stack((Material(1.0, 0.0),) * 2)
    step = next(adapt(scene, 0.1, solver=EXACT))
    prolongation = step.elasticity.prolongation
    supports = find_supports(scene, step.forest, prolongation)

    def with_factor(factor):
        solution = replace(step.solution, row_force=factor * step.solution.row_force)
        state = SolvedState(scene, step.forest, step.elasticity, step.field, step.rows, solution, step.estimate)
        load = np.zeros((prolongation.owned, 3))
        return state, nodal_residual(state, load), load, supports

    return with_factor


@pytest.mark.parametrize("factor", [1.1, 0.9])
def test_share_of_contact_forces(solution, factor):
    """Contact forces that are wrong by a part leave that part of theirs unbalanced on each body."""
    assert unbalanced(*solution(1.0)) < 1e-10
    assert abs(unbalanced(*solution(factor)) - abs(factor - 1) / factor) < 1e-9


def test_reactions_count_little(solution):
    """Without contact forces what is left, F, is seen against a hundredth of the reactions, F on either side."""
    assert abs(unbalanced(*solution(0.0)) - 1 / 0.02) < 1e-6


def test_half_a_percent_is_too_much(solution):
    """A little less passes."""
    check_balance(*solution(1.004))
    with pytest.raises(SolveError, match="of the forces on a body unbalanced"):
        check_balance(*solution(1.006))
