"""Energies of displacements whose strains are known."""

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import DISTRIBUTIONS, STEEL, conforming_positions, discrete, grown, pressed, roots, two_boxes

from fx_contact import Material

pytestmark = pytest.mark.ranks(1, 2, 3)

#: Volumes of the two boxes [m^3].
LOWER, UPPER = 4.0, 8.0


def boxes(poisson, degree, distortion=0.15):
    """Two boxes, the upper one of a Poisson's ratio, and the positions and bodies of the unknowns."""
    upper = Material(1.0, poisson)
    scene = pressed(two_boxes(distortion=distortion), materials=(STEEL, upper))
    forest = DISTRIBUTIONS["strewn"](grown(roots(scene), 2, share=0.2))
    elasticity = discrete(scene, forest, degree=degree)
    assert elasticity.prolongation.hanging_global > 0
    return elasticity, upper, *conforming_positions(forest, elasticity.prolongation)


@pytest.fixture(params=[(0.2, 1), (0.49, 1), (0.2, 2), (0.49, 2)], ids="nu={0[0]}, degree {0[1]}".format)
def problem(request):
    """Two boxes of distorted cells."""
    return boxes(*request.param)


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


def test_change_norm_leaves_out_projected_volume_strains(problem):
    """Of a dilatation, the energy of the volume counts in compressible bodies only."""
    elasticity, upper, position, body = problem
    first, mu = lame(upper)
    volume = 9 * first if upper.poisson < 0.4 else 0.0
    found = elasticity.change_norm(np.where(body[:, None] == 1, position, 0.0)) ** 2
    assert abs(found / (UPPER * (6 * mu + volume)) - 1) < 1e-12


def test_internal_forces(problem):
    """omega^2 = u . P^T K u for any displacement u, whether K is a matrix or forces are integrated from the stress."""
    elasticity, _, position, _ = problem
    u = np.sin(3 * position + [0.0, 1.0, 2.0])
    forces = elasticity.internal_forces(elasticity.field(u))
    assert abs(elasticity.energy_norm(u) ** 2 / WORLD.allreduce(float((u * forces).sum())) - 1) < 1e-12
    matrix = elasticity.stiffness().mat
    matrix.assemble()
    x, y = matrix.createVecs()
    x.array[:] = u.ravel()
    matrix.mult(x, y)
    everywhere(np.abs(y.array - forces.ravel()).max() < 1e-12 * y.norm(), "other forces")


def test_projection_keeps_linear_volume_strains():
    """At degree 2, on affine cells, the volume strain of a quadratic displacement is its divergence."""
    elasticity, upper, position, body = boxes(0.49, 2, distortion=0.0)
    first, mu = lame(upper)
    x, y, z = np.where(body == 1, position.T, 0.0)
    # div u = 2 (x + y + z) on 0 <= x, y, z <= 2: its square has the integral 4 (8 * 9 + 3 * 8 / 3) = 320.
    quadratic = np.stack([x**2, y**2, z**2], axis=1)
    shear = 2 * mu * 4 * 3 * 32 / 3
    assert abs(elasticity.energy_norm(quadratic) ** 2 / (320 * first + shear) - 1) < 1e-12


@pytest.mark.parametrize("poisson", [0.3, 0.4999])
def test_pure_bending(poisson):
    """At degree 2 a bent beam is exact at any Poisson's ratio, hanging nodes or not: only its ends have forces.

    u = (x z, -nu y z, (nu (y^2 - z^2) - x^2) / 2) has the stress sigma_xx = E z alone.
    """
    elasticity, upper, position, body = boxes(poisson, 2, distortion=0.0)
    x, y, z = np.where(body == 1, position.T, 0.0)
    u = np.stack([x * z, -poisson * y * z, (poisson * (y**2 - z**2) - x**2) / 2], axis=1)
    forces = elasticity.internal_forces(elasticity.field(u))
    end = (body == 1) & (np.abs(x - 1) > 1 - 1e-9)
    assert abs(WORLD.allreduce(float(forces[end & (x > 1), 0].sum())) / (upper.young * 4) - 1) < 1e-9
    everywhere(np.abs(forces[~end]).max(initial=0) < 1e-10, "forces within the beam or on its free faces")
