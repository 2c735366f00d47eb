"""The error that PCG leaves is the one that was asked for."""

import numpy as np
import pytest
from model_problems import conforming_positions, discrete, grown, pressed, roots, solved, two_boxes

from fx_contact import Solver
from fx_contact.fem.dirichlet import find_supports


@pytest.mark.parametrize("tolerance, start", [(1e-3, 0.0), (1e-6, 0.0), (1e-3, 100.0)])
def test_error_in_the_energy_norm(tolerance, start, monkeypatch):
    """It is below the tolerance times the energy norm of the solution, by what PCG says and by a solve to rounding.

    So it is from a first guess that has much more energy.
    """
    scene = pressed(two_boxes(margin=1), contact=False)
    forest = grown(roots(scene), 3, share=0.2)
    elasticity = discrete(scene, forest)
    supports = find_supports(scene, forest, elasticity.prolongation)
    position, body = conforming_positions(forest, elasticity.prolongation)
    forces = np.where(body[:, None] == 1, 1e-3 * np.sin(5 * position), 0.0)
    exact = solved(elasticity, None, supports, forces=forces)
    monkeypatch.setattr("model_problems.EXACT", Solver(tolerance=tolerance))
    rough = solved(elasticity, None, supports, forces=forces, start=start * np.sin(5 * position))
    size = elasticity.energy_norm(exact.displacement)
    assert start or sum(rough.krylov_iterations) < sum(exact.krylov_iterations)
    assert rough.energy_error <= tolerance * size * 1.5
    error = elasticity.energy_norm(rough.displacement - exact.displacement)
    assert 0 < error < 5 * tolerance * size
