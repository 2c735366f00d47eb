"""Energies of displacements whose strains are known."""

import numpy as np
import pytest
from conftest import WORLD
from model_problems import STEEL, conforming_positions, discrete, grown, pressed, roots, two_boxes

from fx_contact import Material

#: Volumes of the two boxes [m^3].
LOWER, UPPER = 4.0, 8.0


@pytest.fixture(params=[0.2, 0.49], ids=["compressible", "nearly incompressible"])
def problem(request):
    """Two boxes of distorted cells, the upper one of a Poisson's ratio, and the positions of the unknowns."""
    upper = Material(1.0, request.param)
    forest = grown(roots(pressed(two_boxes(), materials=(STEEL, upper))), 2, share=0.2)
    elasticity = discrete(pressed(two_boxes(), materials=(STEEL, upper)), forest)
    assert elasticity.prolongation.hanging_global > 0
    return elasticity, upper, *conforming_positions(forest, elasticity.prolongation)


def lame(material):
    """Both Lame coefficients [Pa]."""
    young, nu = material.young, material.poisson
    return young * nu / ((1 + nu) * (1 - 2 * nu)), young / (2 * (1 + nu))


def test_energy_norm_of_linear_fields(problem):
    """omega^2 = V (2 mu e:e + lambda (tr e)^2) for a dilatation e = I, and V mu for a simple shear of 1."""
    elasticity, upper, position, _ = problem
    dilatation = sum(v * (6 * mu + 9 * first) for v, (first, mu) in ((LOWER, lame(STEEL)), (UPPER, lame(upper))))
    shear = sum(v * mu for v, (_, mu) in ((LOWER, lame(STEEL)), (UPPER, lame(upper))))
    assert abs(elasticity.energy_norm(position) ** 2 / dilatation - 1) < 1e-12
    assert abs(elasticity.energy_norm(position[:, 2:] * [1.0, 0.0, 0.0]) ** 2 / shear - 1) < 1e-12


def test_change_norm_leaves_out_mean_volume_strains(problem):
    """Of a dilatation, the energy of the volume counts in compressible bodies only."""
    elasticity, upper, position, body = problem
    first, mu = lame(upper)
    volume = 9 * first if upper.poisson < 0.4 else 0.0
    found = elasticity.change_norm(np.where(body[:, None] == 1, position, 0.0)) ** 2
    assert abs(found / (UPPER * (6 * mu + volume)) - 1) < 1e-12


def test_energy_is_the_work_of_internal_forces(problem):
    """omega^2 = u . P^T K u for any displacement."""
    elasticity, _, position, _ = problem
    u = np.sin(3 * position + [0.0, 1.0, 2.0])
    elasticity.set_displacement(u)
    work = WORLD.allreduce(float((u * elasticity.internal_forces()).sum()))
    assert abs(elasticity.energy_norm(u) ** 2 / work - 1) < 1e-12
