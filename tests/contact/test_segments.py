"""Quadrature over overlaps: areas, exact integrals on planes, facets that do not face each other, and slivers."""

import numpy as np
import pytest
from meshed_apart import Side, near

from fx_contact.contact import segments
from fx_contact.contact.polygons import clipped, signed_areas, triangles
from fx_contact.contact.segments import Segments, create_segments
from fx_contact.geometry.root_facets import face_functions
from fx_contact.geometry.solids import block

pytestmark = pytest.mark.ranks(1)


def collected(*arguments, **options):
    """Segments in one piece."""
    parts = list(create_segments(*arguments, **options))
    names = Segments.__dataclass_fields__
    return Segments(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def whole(side, quantity, index):
    """Sums of values at points over facets by their index: (n, ...)."""
    result = np.zeros((len(side), *quantity.shape[1:]))
    np.add.at(result, index, quantity)
    return result


def exact(side):
    """int N over each facet."""
    points, weights = (values / 2 for values in np.polynomial.legendre.leggauss(8))
    uv = np.stack(np.meshgrid(points + 0.5, points + 0.5), axis=-1).reshape(-1, 2)
    jacobian = side.facets.at(np.broadcast_to(uv, (len(side), *uv.shape))).jacobian
    return (jacobian * np.kron(weights, weights)) @ face_functions(side.degree, uv)


def test_special_overlaps():
    """The same quadrilateral, one inside another, a common side, a common corner, nothing in common."""
    square = np.array([[0.0, 0.0], [1, 0], [1, 1], [0, 1]])
    others = np.stack([square, 0.5 * square + 0.25, 3 * square - 1, square + [1, 0], square + 1, square + 2])
    for subject, window in ((others, square + 0 * others), (square + 0 * others, others)):
        polygons, count = clipped(subject, window)
        polygon, corners = triangles(polygons, count)
        assert np.array_equal(np.bincount(polygon, signed_areas(corners), 6), [1, 0.25, 1, 0, 0, 0])


def warped(amount):
    """A distortion of the unit square that keeps its sides."""
    return lambda x: (
        x[0] + amount * np.sin(3 * x[1]) * x[0] * (1 - x[0]),
        x[1] + amount * np.sin(2 * x[0]) * x[1] * (1 - x[1]),
        x[2],
    )


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("amount", [0.0, 0.3, 0.6])
def test_distorted_facets_of_a_plane(degree, amount):
    """Integrals of the functions of both facets, and of products of two, on planes tilted in space."""
    shapes = [
        block((0, 0, low), (1, 1, low + 1), (cells, 3, 1), 1).placed(warped(sign * amount)).turned((1, 2, 3), 35)
        for cells, low, sign in ((3, 0, 1), (4, -1, -1))
    ]
    first, second = (Side.of(shape, degree, side) for shape, side in zip(shapes, ("bottom", "top")))
    determinants = first.facets.at(np.broadcast_to(np.eye(2), (len(first), 2, 2))).jacobian
    assert (np.ptp(determinants, axis=1).max() > 0.03 / 9) == (amount > 0)
    pairs = near(first, second)
    found = collected(first.facets[pairs[:, 0]], second.facets[pairs[:, 1]], degree, np.inf)
    assert (np.diff(found.pair) >= 0).all()
    one, two = pairs[found.pair].T
    at = [found.weight[:, None] * face_functions(degree, uv) for uv in (found.first, found.second)]
    # The digits by which rules for distorted facets are chosen.
    bound = 1e-14 if amount == 0 else exact(second).max() * 10.0**-segments._DIGITS
    assert np.abs(whole(first, at[0], one) - exact(first)).max() < bound
    assert np.abs(whole(second, at[1], two) - exact(second)).max() < bound
    assert abs(found.weight.sum() - 1) < 1e-14 and np.abs(found.apart).max() < 1e-15
    assert np.abs(first.facets[one].at(found.first[:, None]).position[:, 0] - found.position).max() < 1e-15


def test_oblique_direction():
    """Along a direction: vectors are parallel to it, areas those of the first surface, and nothing else is covered."""
    direction = np.array([0.3, 0.0, -1.0]) / np.sqrt(1.09)
    first = Side.of(block((0, 0, 0.5), (1, 1, 1), (3, 3, 1), 1), 2, "bottom")
    second = Side.of(block((0, 0, -1), (1, 1, 0), (4, 4, 1), 1), 2, "top")
    pairs = np.stack(np.divmod(np.arange(9 * 16), 16), axis=1)
    found = collected(first.facets[pairs[:, 0]], second.facets[pairs[:, 1]], 2, np.inf, direction=direction)
    assert abs(found.weight.sum() - 0.85) < 1e-14  # shifted by 0.15 over the border
    assert np.abs(np.cross(found.apart, direction)).max() < 1e-15
    assert np.abs(found.apart[:, 2] + 0.5).max() < 1e-15
    assert (
        np.abs(
            found.position
            + found.apart
            - second.facets[pairs[found.pair, 1]].at(found.second[:, None]).position[:, 0]
        ).max()
        < 1e-15
    )


def test_facets_that_do_not_face():
    """No points on facets that look the same way, are perpendicular, apart, touch, or lie too far behind."""
    first = Side.of(block((0, 0, 0), (1, 1, 1), (1, 1, 1), 1), 2, "bottom").facets
    lower = {
        side: Side.of(block((0, 0, -1), (1, 1, 0), (1, 1, 1), 1), 2, side).facets
        for side in ("top", "bottom", "left")
    }
    assert abs(collected(first, lower["top"], 2, 0.1).weight.sum() - 1) < 1e-15
    for name in ("bottom", "left"):
        assert sum(len(part.weight) for part in create_segments(first, lower[name], 2, np.inf)) == 0
    for shift in ((1, 0, 0), (0, -1, 0), (1, 1, 0), (3, 0, 0)):
        other = Side.of(block((0, 0, -1), (1, 1, 0), (1, 1, 1), 1).shifted(*shift), 2, "top").facets
        assert sum(len(part.weight) for part in create_segments(first, other, 2, np.inf)) == 0
    inside = Side.of(block((0, 0, -1), (1, 1, 0), (1, 1, 1), 1).shifted(z=0.3), 2, "top").facets
    assert sum(len(part.weight) for part in create_segments(first, inside, 2, 0.2)) == 0
    found = collected(first, inside, 2, 0.4)
    assert np.abs(found.apart - [0, 0, 0.3]).max() < 1e-15
    assert (
        np.abs(found.first_normal - [0, 0, -1]).max() < 1e-15
        and np.abs(found.second_normal - [0, 0, 1]).max() < 1e-15
    )


@pytest.mark.parametrize("shift", [1e-16, 1e-15, 3e-14, 1e-12, 1e-8, 1e-3])
def test_slivers(shift):
    """A mesh shifted by next to nothing: everything is finite, and no area is lost."""
    first = Side.of(block((0, 0, 0), (1, 1, 1), (3, 3, 1), 1), 2, "bottom")
    second = Side.of(block((-1, -1, -1), (2, 2, 0), (9, 9, 1), 1).shifted(shift, shift / 2), 2, "top")
    pairs = np.stack(np.divmod(np.arange(9 * 81), 81), axis=1)
    found = collected(first.facets[pairs[:, 0]], second.facets[pairs[:, 1]], 2, np.inf)
    for values in vars(found).values():
        assert np.isfinite(values).all()
    loads = found.weight[:, None] * face_functions(2, found.first)
    assert np.abs(whole(first, loads, pairs[found.pair, 0]) - exact(first)).max() < 1e-15
