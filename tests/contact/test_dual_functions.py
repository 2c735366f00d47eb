"""Dual multipliers: matching meshes, planes meshed apart, round surfaces, partial cover, and what is exact for all.

u is transferred from the second surface to the nodes of the first by D^-1 M.
"""

import numpy as np
import pytest
from meshed_apart import Mortar, Side, hollow_ball
from model_problems import scramble

from fx_contact.contact.dual_functions import _sums
from fx_contact.geometry.root_facets import face_functions
from fx_contact.geometry.solids import ball, block

pytestmark = pytest.mark.ranks(1)

LINEAR = np.array([[0.3, -1.0, 0.7], [0.2, 0.5, 1.0], [-0.6, 0.1, 0.4]])


def plates(cells, degree, turn=0.0, tilt=0.0, random=(0, 0), order=1, levels=(0, 0), second_size=1.5):
    """The bottom of a plate of side 1 on a larger one, turned in their plane and tilted together: both sides."""
    upper = block((-0.5, -0.5, 0), (0.5, 0.5, 1), (cells[0], cells[0], 1), order).turned("z", turn)
    half = second_size / 2
    lower = block((-half, -half, -1), (half, half, 0), (cells[1], cells[1], 1), order)
    sides = []
    for shape, name, number, level in zip((upper, lower), ("bottom", "top"), random, levels):
        tilted = shape.turned((1, 2, 0.5), tilt).shifted(0.3, -0.2, 0.1)
        sides.append(Side.of(tilted, degree, name, level, number))
    return sides


def dual_errors(mortar):
    """Of the sum of psi at random points, and of their biorthogonality on facets that are covered."""
    functions = mortar.functions
    points = (scramble(np.arange(2 * len(functions) * 4)) / 2.0**64).reshape(len(functions), 4, 2)
    psi = face_functions(mortar.first.degree, points) @ functions.swapaxes(1, 2)
    some = mortar.kept.any(axis=1)
    mixed = mortar.integrals.first[mortar.dual.covered & mortar.kept.all(axis=1)]
    diagonal = np.einsum("ejj->ej", mixed)
    mixed = mixed - diagonal[:, :, None] * np.eye(mixed.shape[1])
    return np.abs(psi.sum(axis=2)[some] - 1).max(), np.abs(mixed).max(initial=0) / np.abs(diagonal).max(initial=1)


def on_spheres(degree, order, cells, shells, level):
    """Largest errors of the first surface's areas and of the gap, L2 error of the transfer, largest one of forces."""
    inner = Side.of(ball(1.0, 2 * cells, order), degree, "outside", level)
    outer = Side.of(hollow_ball(3 * cells, 1.01, 1.5, order), degree, "bottom", level)
    first, second = (outer, inner) if shells else (inner, outer)
    mortar = Mortar(first, second)
    assert mortar.dual.covered.all() and max(dual_errors(mortar)) < 1e-13
    on = np.flatnonzero(mortar.area)
    assert (mortar.area[on] > 0).all()
    area = mortar.area[on, None]
    normal = first.sums(mortar.integrals.first_normal)[on]
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    gap = np.einsum("ni,ni->n", first.sums(mortar.integrals.apart)[on] / area, normal)
    values = [wave(side.positions) for side in (first, second)]
    moved = mortar.M[on] @ values[1] / area[:, 0] - values[0][on]
    stretch = (1.01 if shells else 1 / 1.01) ** 2
    force = (mortar.M.T @ np.ones(first.count) / stretch - second.loads) / second.loads.max()
    mine = mortar.area[on] / first.loads[on]
    return [np.abs(mine - 1).max(), np.abs(gap - 0.01).max(), np.sqrt((moved**2).mean()), np.abs(force).max()]


def wave(positions):
    """A smooth function of the direction, alike on both surfaces."""
    x, y, z = positions.T / np.linalg.norm(positions, axis=1).clip(1e-9)
    return np.sin(2 * x + y) + x * z


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("order", [2, 6])
@pytest.mark.parametrize("shells", [False, True])
def test_round_surfaces(degree, order, shells):
    """A ball in a hollow ball, either first: errors fall with h."""
    coarse, fine = (on_spheres(degree, order, cells, shells, 1) for cells in (1, 2))
    rates = np.log2(np.divide(coarse, fine))
    # The area by the rule, the gap by the geometry and the mean of normals, the transfer as interpolation.
    assert (rates >= [2.9, 1.9, degree + 0.8, 0.7]).all(), (rates, coarse, fine)
    assert fine[0] < 2e-6 and fine[1] < 4e-4 and fine[2] < [3e-3, 2e-4][degree - 1] and fine[3] < 3e-3


def rim(degree, width, cells=4, random=0, turn=0.0, shift=0.0):
    """A plate of side 1 over another that ends at x = width, turned about the middle of its border."""
    upper = Side.of(block((0, 0, 0), (1, 1, 1), (cells, cells, 1), 1), degree, "bottom", random=random)
    size = 2 * cells
    lower = block((width - 2, -1, -1), (width, 1, 0), (size + 1, size, 1), 1).shifted(-width, shift).turned("z", turn)
    return upper, Side.of(lower.shifted(width, 0.5), degree, "top")


def condition(mortar):
    """Of the Gram matrix B B^T of rows of like length."""
    on = np.flatnonzero(mortar.kept_nodes)
    rows = np.hstack([mortar.D[on].toarray(), -mortar.M[on].toarray()]) / mortar.area[on, None]
    rows /= np.linalg.norm(rows, axis=1)[:, None]
    return np.linalg.cond(rows @ rows.T)


def check_cover(mortar, covered):
    """Psi add up to 1 and have positive integrals; force and moments of a constant pressure balance."""
    first, second = mortar.first, mortar.second
    on = mortar.kept_nodes.astype(float)
    assert ((mortar.area > 0) == mortar.kept_nodes).all() and (mortar.area >= 0).all()
    assert max(dual_errors(mortar)) < 1e-13
    loads = [mortar.D.T @ on, mortar.M.T @ on]
    for side, load in zip((first, second), loads):
        assert abs(load.sum() - covered) < 1e-14
    moments = [load @ side.positions for side, load in zip((first, second), loads)]
    assert np.abs(moments[0] - moments[1]).max() < 1e-14
    assert abs(mortar.area.sum() - covered) < 1e-14
    linear = [side.positions @ LINEAR.T + 0.2 for side in (first, second)]
    assert np.abs(mortar.D @ linear[0] - mortar.M @ linear[1]).max() < 1e-14
    assert np.abs(np.ravel(mortar.M.sum(axis=1)) - mortar.area).max() < 1e-15


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("random", [0, 2])
@pytest.mark.parametrize(
    "part", [0.0, 1e-15, 1e-14, 1e-10, 1e-6, 1e-3, 0.1, 0.17, 1 / 3, 0.5, 0.9, 0.97, 1 - 1e-6, 1 - 1e-14]
)
def test_rim_through_facets(degree, random, part):
    """A plate over another's edge, which crosses the third row of facets at any part of it."""
    width = (2 + part) / 4
    first, second = rim(degree, width, random=random)
    assert first.hanging.any() == (random > 0)
    mortar = Mortar(first, second)
    check_cover(mortar, width)
    assert condition(mortar) < 500


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("part", [1e-12, 1e-6, 1e-3, 0.1, 1 / 3, 0.6])
def test_only_a_strip(degree, part):
    """No facet is covered by more than a strip."""
    first, second = rim(degree, part / 4)
    mortar = Mortar(first, second)
    assert not mortar.dual.covered.any()
    check_cover(mortar, part / 4)
    assert mortar.kept_nodes.sum() >= 5 and condition(mortar) < 500


@pytest.mark.parametrize("degree", [1, 2])
def test_rims_at_random(degree):
    """Rims that cross facets at any angle, with hanging nodes."""
    for number, (width, turn, shift) in enumerate(scramble(np.arange(90)).reshape(30, 3) / 2.0**64):
        first, second = rim(degree, 0.2 + 0.6 * width, random=number % 3, turn=60 * turn - 30, shift=0.2 * shift)
        mortar = Mortar(first, second)
        assert mortar.dual.covered.any() and not mortar.dual.covered.all()
        assert not mortar.kept_nodes[np.unique(first.nodes)].all()
        check_cover(mortar, mortar.segments.coupling.sum())
        assert condition(mortar) < 500


def test_no_kept_node():
    """A facet without any kept node has no multiplier; nothing else is undefined."""
    first, second = plates((2, 2), 2)
    mortar = Mortar(first, second, held=range(first.count))
    assert (mortar.functions == 0).all() and (mortar.area == 0).all()
    apart = Mortar(first, Side.of(block((5, 5, -1), (6, 6, 0), (1, 1, 1), 1), 2, "top"))
    assert not len(apart.pairs) and not apart.kept.any() and (apart.functions == 0).all()


def test_no_point():
    """Facets that face each other in the pairing may have no common point: no row, the right number of functions."""
    assert face_functions(2, np.zeros((0, 2))).shape == (0, 9)
    assert _sums(np.zeros(0, dtype=np.int64), 2, np.zeros((0, 4)), np.zeros((0, 9))).shape == (2, 36)
