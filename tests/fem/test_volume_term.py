"""The volume term of the mixed form: what the matrix lacks, moments of known divergences."""

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import DISTRIBUTIONS, STEEL, conforming_positions, discrete, grown, pressed, roots, two_boxes
from mpi4py import MPI

from fx_contact import Material
from fx_contact.fem.supports import Supports

pytestmark = pytest.mark.ranks(1, 2, 3)

#: Of the upper box, and its volume [m^3].
RUBBER, UPPER = Material(1.0, 0.49), 8.0


@pytest.fixture(params=list(DISTRIBUTIONS))
def problem(request):
    """Two boxes of distorted cells with hanging nodes, the upper one of rubber: elasticity, positions and bodies."""
    scene = pressed(two_boxes(distortion=0.15), materials=(STEEL, RUBBER))
    forest = DISTRIBUTIONS[request.param](grown(roots(scene), 2, share=0.2))
    elasticity = discrete(scene, forest, degree=2)
    assert elasticity.prolongation.hanging_global > 0 and elasticity.mixed
    return elasticity, *conforming_positions(forest, elasticity.prolongation)


def product(elasticity, u, **how):
    """The assembled matrix times a displacement, and its diagonal."""
    matrix = elasticity.stiffness(**how).mat
    matrix.assemble()
    x, y = matrix.createVecs()
    x.array[:] = u.ravel()
    matrix.mult(x, y)
    return y.array.reshape(-1, 3).copy(), matrix.getDiagonal().array.reshape(-1, 3).copy()


def test_matrix_and_volume_term_are_the_stiffness(problem):
    """K = A + D^T C D, and so on the diagonal; prescribed components get no force."""
    elasticity, position, _ = problem
    u = np.sin(3 * position + [0.0, 1.0, 2.0])
    free = position[:, [2, 0, 1]] > 0.3
    volume = elasticity.volume_term(Supports(np.where(free, np.nan, 0.0)))
    whole, diagonal = product(elasticity, u)
    rest, part = product(elasticity, u, mixed=True)
    forces = volume.forces(volume.missing * volume.strains(u))
    scale = WORLD.allreduce(float((whole**2).sum())) ** 0.5
    assert WORLD.allreduce(float(((whole - rest)[free] ** 2).sum())) ** 0.5 > 0.1 * scale
    everywhere(np.abs((whole - rest - forces)[free]).max(initial=0) < 1e-12 * scale, "another stiffness")
    everywhere(np.abs((diagonal - part - volume.diagonal())[free]).max(initial=0) < 1e-12 * scale, "another diagonal")
    everywhere(not forces[~free].any(), "a force where a displacement is prescribed")


def test_the_whole_stiffness_assembled(problem):
    """A + D^T C D as a matrix is K: rows of free components by columns of those, also of nodes on oblique planes."""
    elasticity, position, _ = problem
    supports = _with_an_oblique_plane(position)
    u = supports.free_part(np.sin(3 * position + [0.0, 1.0, 2.0]))
    whole, _ = product(elasticity, u, supports=supports)
    rest = elasticity.stiffness(mixed=True, supports=supports).mat
    rest.assemble()
    before = rest.copy()
    volume, any_u = elasticity.volume_term(supports), np.cos(position)
    across = volume.strains(any_u) - volume.strains(supports.tangential(any_u))
    everywhere(np.abs(across).max(initial=0) < 1e-12, "strains across planes")
    volume.add_to(rest)
    x, y = rest.createVecs()
    x.array[:] = u.ravel()
    rest.mult(x, y)
    scale, free = WORLD.allreduce(float((whole**2).sum())) ** 0.5, supports.free
    everywhere(np.abs((y.array.reshape(-1, 3) - whole)[free]).max(initial=0) < 1e-12 * scale, "another stiffness")
    rest.axpy(-1.0, before)
    x.array[:] = (np.sin(position) - supports.free_part(np.sin(position))).ravel()
    rest.mult(x, y)
    assert WORLD.allreduce(float(np.abs(y.array).max(initial=0)), op=MPI.MAX) < 1e-12 * scale, "held directions"


def _with_an_oblique_plane(position):
    """Supports with some components held, and u_x = u_y where x > 1/2."""
    free, normal = position[:, [2, 0, 1]] > 0.3, np.array([1.0, -1.0, 0.0]) / np.sqrt(2)
    nodes = np.flatnonzero((position[:, 0] > 0.5) & free.all(axis=1))
    along = np.broadcast_to(np.eye(3) - np.outer(normal, normal), (len(nodes), 3, 3))
    return Supports(np.where(free, np.nan, 0.0), (nodes, along))


def test_rows(problem):
    """|D u|^2 is the integral of (div u)^2 over the soft body: 9 V of a dilatation, 0 of a shear or the other body.

    C = lambda - lambda_A, and S = C^-1 + (2 mu + lambda_A)^-1, with lambda_A of Poisson's ratio 0.3.
    """
    elasticity, position, body = problem
    volume = elasticity.volume_term(Supports(np.full_like(position, np.nan)))
    shear, other = position[:, 2:] * [1.0, 0.0, 0.0], (body == 0)[:, None] * position
    for u, square in ((position, 9 * UPPER), (shear, 0.0), (other, 0.0)):
        assert abs(WORLD.allreduce(float((volume.strains(u) ** 2).sum())) - square) < 1e-12 * 9 * UPPER
    mu = 1 / (2 * 1.49)
    first, of_matrix = 2 * mu * 0.49 / 0.02, 2 * mu * 0.3 / 0.4
    everywhere(np.abs(volume.missing / (first - of_matrix) - 1).max(initial=0) < 1e-12, "another C")
    schur = 1 / (1 / (first - of_matrix) + 1 / (2 * mu + of_matrix))
    everywhere(np.abs(volume.schur / schur - 1).max(initial=0) < 1e-12, "another S")
