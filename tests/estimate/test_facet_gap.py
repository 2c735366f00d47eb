"""The least gap between facets is found wherever it is."""

import numpy as np
import pytest

from fx_contact.estimate.inter_node_gap import FacetGap


def facets(height, side, slope=(0.0, 0.0)):
    """A FacetGap of facets between a plane z = slope . (x, y) and surfaces that are so much higher.

    Args:
        height: function of x and y (m^2,), the gap along z (n, m^2) [m].
        side: points along a side, m.
        slope: of the plane.
    """
    line = np.linspace(0, 1, side)
    x, y = (grid.ravel() for grid in np.meshgrid(line, line))
    apart = height(x, y)
    normal = np.broadcast_to([-slope[0], -slope[1], 1.0], (*apart.shape, 3))
    return FacetGap(apart[:, :, None] * [0.0, 0.0, 1.0], normal)


def valleys(number, aspect, pole):
    """Parabolas that touch 0 at a pole, turned by random angles: function of x and y."""
    random = np.random.default_rng(number)
    angle = random.uniform(0, np.pi, (len(pole), 1))

    def height(x, y):
        x, y = x - pole[:, :1], y - pole[:, 1:]
        along, across = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
        return along**2 / aspect + across**2

    return height


@pytest.mark.parametrize("slope", [(0.0, 0.0), (1.0, -2.0)])
@pytest.mark.parametrize("aspect", [1, 10, 100])
@pytest.mark.parametrize("side", [3, 5, 7])
def test_touching_valleys(side, aspect, slope):
    """Parabolas touch at their poles alone, inside, on sides and at corners of the facet."""
    random = np.random.default_rng(side)
    pole = np.concatenate([random.uniform(0, 1, (30, 2)), random.uniform(0, 1, (16, 2)).round(0)])
    pole[30:38, 0] = random.uniform(0, 1, 8)
    height = valleys(side, aspect, pole)
    least = facets(height, side, slope).least()
    assert np.abs(least).max() < 1e-9
    for depth in (1e-8, 1e-4):
        least = facets(lambda x, y: height(x, y) - depth, side, slope).least()
        assert np.abs(least * np.sqrt(1 + slope[0] ** 2 + slope[1] ** 2) / -depth - 1).max() < 0.1


def test_poles_beside_the_facet():
    """Where the pole is outside, a parabola is least on a side: as a fine grid has it."""
    pole = np.random.default_rng(0).uniform(-1, 2, (300, 2))
    pole = pole[((pole < 0) | (pole > 1)).any(axis=1)]
    height = valleys(1, 5.0, pole)
    gap, line = facets(height, 3), np.linspace(0, 1, 401)
    ends, along = np.repeat([0.0, 1.0], len(line)), np.tile(line, 2)
    sampled = np.minimum(gap.at(ends, along).min(axis=1), gap.at(along, ends).min(axis=1))
    assert (sampled > 1e-3).any() and np.abs(gap.least() - sampled).max() < 1e-5


def test_waves():
    """Polynomials of a higher order have several valleys; the deepest one counts."""

    def height(x, y):
        wave = (x - 0.15) ** 2 * (x - 0.55) ** 2 * (1 + 0.1 * x) ** 2
        return 50 * wave + (y - 0.37) ** 2 + 0.01 * np.array([[0.0], [1.0]]) * x

    first, second = facets(height, 7).least()
    line = np.linspace(0, 1, 100001)
    expected = 50 * (line - 0.15) ** 2 * (line - 0.55) ** 2 * (1 + 0.1 * line) ** 2 + 0.01 * line
    assert abs(first) < 1e-8 and 1e-4 < second <= expected.min() * (1 + 1e-9)


def test_rough_facets():
    """Where surfaces are so rough that nothing is sure, most of the least gaps are found."""
    random, line = np.random.default_rng(6), np.linspace(0, 1, 41)
    gap = facets(lambda x, y: random.normal(size=(200, len(x))), 5)
    sampled = gap.at(*np.stack(np.meshgrid(line, line)).reshape(2, -1)).min(axis=1)
    assert (gap.least() > sampled + 1e-6).mean() < 0.01


def test_normals_turn():
    """The gap of a round facet is that along its normals, of any length: between two radii, their difference."""
    angle = np.linspace(0.25 * np.pi, 0.75 * np.pi, 9)
    angle, y = (grid.ravel() for grid in np.meshgrid(angle, np.linspace(0, 1, 9)))
    circle, out = (np.stack([-np.cos(angle), level * y, np.sin(angle)], axis=1)[None] for level in (1, 0))
    for sign in (1, -1):
        gap = FacetGap(circle * [1.1, 1, 1.1] - circle, 3 * sign * out)
        assert np.allclose(gap.at(np.array([[0.1, 0.5, 0.77]]), np.array([[0.3, 0.2, 0.9]])), 0.1 * sign)
        assert np.allclose(gap.sampled(), 0.1 * sign)
