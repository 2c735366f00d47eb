"""Dual multipliers: matching meshes, planes meshed apart, round surfaces, partial cover, and what is exact for all.

u is transferred from the second surface to the nodes of the first by D^-1 M.
"""

import numpy as np
import pytest
from meshed_apart import Mortar, Side, hollow_ball
from model_problems import scramble

from fx_contact.contact.dual_functions import DualFunctions, SegmentIntegrals
from fx_contact.geometry.root_facets import face_functions
from fx_contact.geometry.shapes import rotation
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


def covered_loads(mortar):
    """int N2~ over the covered part of the second surface, without psi."""
    sums = mortar.segments.coupling.sum(axis=1)  # the N of the first add up to 1
    return mortar.second.of_facets(mortar.pairs[:, 1], sums)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("turn, tilt", [(0, 0), (20, 0), (45, 35)])
@pytest.mark.parametrize("cells, random", [((4, 4), (2, 0)), ((6, 6), (1, 2)), ((4, 3), (0, 2)), ((4, 2), (1, 3))])
def test_planes_meshed_apart(degree, turn, tilt, cells, random):
    """With hanging nodes on either side: constant pressure, linear displacements, and a linear gap are exact."""
    first, second = plates(cells, degree, turn, tilt, random)
    assert (first.hanging.sum() > 0) == (random[0] > 0) and (second.hanging.sum() > 0) == (random[1] > 0)
    mortar = Mortar(first, second)
    assert mortar.dual.covered.all() and mortar.kept.all()
    assert max(dual_errors(mortar)) < 1e-13
    on = mortar.area != 0
    assert (mortar.area[on] > 0).all() and on.sum() == len(np.unique(first.nodes))
    area = mortar.D.diagonal()
    assert np.abs(mortar.D - np.diag(area)).max() < 1e-14 and np.abs(area - mortar.area).max() < 1e-14
    assert np.abs(area - first.loads).max() < 1e-14
    # Forces of a constant pressure: on both surfaces those of the covered part.
    assert np.abs(mortar.D.T @ on - first.loads).max() < 1e-14
    assert np.abs(mortar.M.T @ on - covered_loads(mortar)).max() < 1e-14
    # Linear displacements, and rigid ones.
    linear = [side.positions @ LINEAR.T + [0.1, 0.2, 0.3] for side in (first, second)]
    assert np.abs(mortar.M @ linear[1] - area[:, None] * linear[0])[on].max() < 1e-13
    assert np.abs(mortar.M @ np.ones(second.count) / np.where(on, area, 1) - on).max() < 1e-12
    # Normals and the gap, which is zero.
    normal = rotation((1, 2, 0.5), tilt) @ [0, 0, 1.0]
    for sign, normals in ((-1, mortar.integrals.first_normal), (1, mortar.integrals.second_normal)):
        assert np.abs(first.sums(normals) - sign * area[:, None] * normal).max() < 1e-14
    assert np.abs(first.sums(mortar.integrals.apart)).max() < 1e-14


@pytest.mark.parametrize("degree", [1, 2])
def test_whole_second_surface(degree):
    """Surfaces of one size: sum_j M_jl is the integral of the second surface's function, 3:4 with hanging nodes."""
    first, second = plates((4, 3), degree, random=(1, 1), second_size=1.0)
    assert first.hanging.any() and second.hanging.any()
    mortar = Mortar(first, second)
    assert np.abs(mortar.M.sum(axis=0) - second.loads).max() < 1e-14
    assert abs(mortar.M.sum() - 1) < 1e-13


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("order", [1, 2, 6])
def test_matching_meshes(degree, order):
    """Meshed alike, hanging nodes too: D^-1 M pairs nodes, on a plane and on a bent surface."""
    for bend in (0.0, 0.2):

        def bent(x):
            return x[0], x[1], x[2] + bend * np.sin(2 * x[0] + x[1])

        shapes = [block((0, 0, low), (1, 1, low + 1), (3, 3, 1), order).placed(bent) for low in (0, -1)]
        upper, lower = (Side.of(shape, degree, side) for shape, side in zip(shapes, ("bottom", "top")))
        marked = upper.facets.corners.mean(axis=1)[:, 0] < 0.4
        assert 0 < marked.sum() < 9
        sides = [refined_near(side, name) for side, name in ((upper, "bottom"), (lower, "top"))]
        first, second = sides
        assert first.hanging.any() and len(first) == len(second)
        mortar = Mortar(first, second)
        on = np.flatnonzero(mortar.area)
        transfer = mortar.M[on].toarray() / mortar.area[on, None]
        match = np.abs(first.positions[on][:, None] - second.positions[np.unique(second.nodes)]).max(axis=2)
        partner = np.unique(second.nodes)[match.argmin(axis=1)]
        assert match.min(axis=1).max() < 1e-13 and len(np.unique(partner)) == len(on)
        expected = np.zeros_like(transfer)
        expected[np.arange(len(on)), partner] = 1
        assert np.abs(transfer - expected).max() < 1e-12


def refined_near(side, name):
    """The side with its leaves at x < 0.4 refined."""
    forest, _ = side.forest.refined(side.forest.centres[:, 0] < 0.4)
    return Side(forest, f"body {name}", side.degree)


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


@pytest.mark.parametrize("degree", [1, 2])
def test_nodes_without_multiplier(degree):
    """Nodes that are held along the normal: their multipliers go to neighbours, and nothing else changes."""
    first, second = plates((4, 3), degree, random=(1, 0))
    assert first.hanging.any()
    x = first.positions - first.positions[np.unique(first.nodes)].mean(axis=0)
    on = np.unique(first.nodes)
    held = on[x[on, 0] < x[on, 0].min() + 1e-9]
    assert len(held) >= 5
    mortar = Mortar(first, second, held=held)
    assert not mortar.kept_nodes[held].any() and mortar.kept_nodes.sum() == len(on) - len(held)
    check_cover(mortar, 1.0)
    everything = Mortar(first, second)
    far = on[x[on, 0] > x[on, 0].min() + 0.6]
    assert len(far) and np.abs((mortar.M - everything.M)[far]).max() == 0


def test_no_kept_node():
    """A facet without any kept node has no multiplier; nothing else is undefined."""
    first, second = plates((2, 2), 2)
    mortar = Mortar(first, second, held=range(first.count))
    assert (mortar.functions == 0).all() and (mortar.area == 0).all()
    apart = Mortar(first, Side.of(block((5, 5, -1), (6, 6, 0), (1, 1, 1), 1), 2, "top"))
    assert not len(apart.pairs) and not apart.kept.any() and (apart.functions == 0).all()


def test_rank_without_facets():
    """A rank without first facets makes arrays of length zero."""
    _, second = plates((2, 2), 2)
    none = second.facets[np.zeros(0, dtype=int)]
    segments = SegmentIntegrals.of(none, second.facets, np.zeros((0, 2), dtype=int), 2)
    dual = DualFunctions(none, 2, np.zeros((0, 9, 9)), segments)
    integrals = dual.integrals(dual.candidates(dual.cover))
    assert integrals.area.shape == (0, 9) and integrals.second.shape == (0, 9, 9)
