"""What displacement conditions hold at nodes: components, and directions across planes oblique to the axes."""

from itertools import product

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import ALONG, DISTRIBUTIONS, PLANES, conforming_positions, discrete, grown, roots, wedge
from petsc4py import PETSc

from fx_contact import Dirichlet, SceneError
from fx_contact.fem.coarse_level import create_coarse_level
from fx_contact.fem.dirichlet import find_supports, held_nodes, shared_forces
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space

pytestmark = pytest.mark.ranks(1, 2, 3)

#: Unit normals of the planes, and of the side "top".
NORMALS = np.linalg.inv(ALONG) / np.linalg.norm(np.linalg.inv(ALONG), axis=1)[:, None]


@pytest.fixture(params=list(DISTRIBUTIONS))
def problem(request):
    """A wedge of affine cells with hanging nodes, also on its planes, its top is held along x: scene, forest."""
    scene = wedge(held=(*PLANES, Dirichlet("top", x=0.0)), distortion=0.0)
    return scene, DISTRIBUTIONS[request.param](grown(roots(scene), 2, share=0.1))


def on_planes(position):
    """Which of the planes each position is on: (n, 3) bool."""
    return np.abs(position @ NORMALS.T) < 1e-9


def noise(position):
    """A displacement without any symmetry."""
    return np.sin(5 * position @ np.array([[1.0, 0.3, 0.0], [0.2, 1.0, -0.5], [0.0, 0.4, 1.0]]) + [0.0, 1.0, 2.0])


@pytest.mark.parametrize("degree", [1, 2])
def test_planes_leave_motions_along_them(problem, degree):
    """Of a displacement stays what lies on all planes of a node: a plane, their common line, or nothing."""
    scene, forest = wedge(distortion=0.0), problem[1]
    prolongation = Prolongation(Space(forest, degree))
    hanging = prolongation.space.positions(prolongation.hanging)
    assert WORLD.allreduce(int(on_planes(hanging).any(axis=1).sum())) > 5, "no hanging nodes on planes"
    position, _ = conforming_positions(forest, prolongation)
    on, u = on_planes(position), noise(position)
    found = find_supports(scene, forest, prolongation).admissible(u)
    everywhere(np.abs(np.where(on, found @ NORMALS.T, 0.0)).max(initial=0.0) < 1e-14, "a node leaves its plane")
    for which in map(np.array, product([False, True], repeat=3)):
        normals = NORMALS[which]
        kept = np.eye(3) - np.linalg.pinv(normals) @ normals
        here = (on == which).all(axis=1)
        everywhere(np.abs(found[here] - u[here] @ kept).max(initial=0.0) < 1e-14, f"other motions on planes {which}")
    assert WORLD.allreduce(int((on.sum(axis=1) > 1).sum())) > 5


@pytest.mark.parametrize("degree", [1, 2])
def test_matrix_of_what_is_free(problem, degree):
    """K is projected, P K P, on hanging nodes too, and at degree 2 so is the coarse matrix, I^T P K P I.

    Prescribed components keep their diagonal entries, and their displacements load the others.
    """
    scene, forest = problem
    elasticity = discrete(scene, forest, degree=degree)
    supports = find_supports(scene, forest, elasticity.prolongation)
    position, _ = conforming_positions(forest, elasticity.prolongation)

    def times(matrix, u):
        matrix.assemble()
        x, y = matrix.createVecs()
        x.array[:] = u.ravel()
        matrix.mult(x, y)
        return y.array.reshape(-1, 3).copy()

    def equal(one, other):
        size, error = (WORLD.allreduce(float((values**2).sum())) ** 0.5 for values in (other, one - other))
        assert error < 1e-13 * size

    u, whole, eliminated = noise(position), elasticity.stiffness().mat, elasticity.stiffness(supports=supports)
    matrix, free = eliminated.mat, supports.free
    expected = supports.free_part(times(whole, supports.free_part(u)))
    diagonal = whole.getDiagonal().array.reshape(-1, 3)
    equal(times(matrix, u), np.where(free, expected, diagonal * u))
    moved = find_supports(scene, forest, elasticity.prolongation)
    moved.prescribed += noise(position)
    equal(
        supports.free_part(elasticity.stiffness(supports=moved).held), supports.free_part(times(whole, moved.values))
    )
    across = np.where(free, u - supports.tangential(u), 0.0)
    supports.add_normal_part(matrix, matrix.getDiagonal().array.reshape(-1, 3))
    held = times(matrix, across)
    stiffness = (held * across).sum(axis=1) / np.maximum((across**2).sum(axis=1), 1e-30)
    everywhere(np.abs(held - stiffness[:, None] * across).max(initial=0.0) < 1e-13, "held directions are coupled")
    everywhere((stiffness[across.any(axis=1)] > 0.01).all(), "held directions without stiffness")
    if degree == 2:
        _check_coarse_level(elasticity, supports)


def _check_coarse_level(elasticity, supports):
    """Interpolated displacements are admissible, and K_c = I^T K I; coarse unknowns are in frames along the planes."""
    coarse = create_coarse_level(elasticity, supports)
    below = Prolongation(Space(elasticity.prolongation.space.forest, 1))
    place = below.injected(elasticity.prolongation.find(below.space.keys))
    (x, y), z = coarse.interpolation.createVecs(), coarse.interpolation.createVecRight()
    position, _ = conforming_positions(below.space.forest, below)
    frames = supports.ghosted(elasticity.prolongation).at(place).in_frames()
    x.array[:] = np.where(frames.free, noise(position), 0.0).ravel()
    coarse.interpolation.mult(x, y)
    moved = y.array.reshape(-1, 3)
    everywhere(np.abs(moved - supports.free_part(moved)).max(initial=0.0) < 1e-13, "off the planes")
    matrix = elasticity.stiffness(supports=supports).mat
    matrix.assemble()
    matrix.convert(PETSc.Mat.Type.AIJ).ptap(coarse.interpolation).mult(x, z)
    other = z.duplicate()
    coarse.matrix.mult(x, other)
    assert (other - z).norm() < 1e-12 * z.norm()
    moved = frames.tangential(np.where(frames.free, noise(position), 0.0))
    lengths = [(values**2).sum(axis=1) for values in (moved, x.array.reshape(-1, 3))]
    everywhere(np.abs(lengths[0] - lengths[1]).max(initial=0.0) < 1e-13, "frames that are not orthonormal")


def test_what_holds_a_node_shares_its_force(problem):
    """Forces of all conditions add up to what is held of the residual; each is along what its condition holds."""
    scene, forest = problem
    prolongation = Prolongation(Space(forest, 2))
    position, _ = conforming_positions(forest, prolongation)
    supports, held = find_supports(scene, forest, prolongation), held_nodes(prolongation, scene.conditions)
    residual = noise(position)
    shared, total = shared_forces(scene.conditions, held, residual), np.zeros_like(residual)
    for condition, nodes in zip(scene.conditions, held):
        total[nodes] += shared[nodes] @ condition.across
    everywhere(np.abs(total - residual + supports.free_part(residual)).max() < 1e-13, "another sum")


def test_a_displacement_across_a_plane():
    """It is an error where the nodes of the root mesh show it, and where those of leaves do; along the plane none."""
    sideways = 0.01 * ALONG[:, 0]
    assert len(wedge(held=(*PLANES, Dirichlet("right", *sideways))).conditions) == 4, "along two of the planes"
    message = "plane 'left' holds .* another condition prescribes .* there, at"
    with pytest.raises(SceneError, match=message):
        wedge(held=(*PLANES, Dirichlet("top", *sideways)))

    def between(x):
        """0 at the root mesh's nodes of the edges."""
        return np.round(0.01 * np.sin(3 * np.pi * (NORMALS[1] @ x) / (NORMALS[1] @ ALONG[:, 1])) ** 2, 12)

    scene = wedge(held=(*PLANES, Dirichlet("top", x=between)))
    forest, _ = roots(scene).refined(np.ones(len(roots(scene)), dtype=bool))
    with pytest.raises(SceneError, match=message):
        find_supports(scene, forest, Prolongation(Space(forest, 1)))
