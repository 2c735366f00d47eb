"""Foot points of targets on curved facets, near and far, and those of targets beyond their root facets."""

import numpy as np
import pytest
from meshed_apart import Side, hollow_ball
from model_problems import scramble

from fx_contact.contact.foot_points import places_in_planes
from fx_contact.contact.polygons import Bilinear
from fx_contact.geometry.solids import ball, block

pytestmark = pytest.mark.ranks(1)


def frames(facets):
    """Two unit vectors across the mean normal of each facet."""
    one = np.cross(np.eye(3)[np.abs(facets.mean_normal).argmin(axis=1)], facets.mean_normal)
    one /= np.linalg.norm(one, axis=1)[:, None]
    return np.stack([one, np.cross(facets.mean_normal, one)], axis=1)


def coordinates(count, low=0.0, high=1.0):
    """Random ones (count, 5, 2)."""
    return low + (high - low) * (scramble(np.arange(10 * count)) / 2.0**64).reshape(count, 5, 2)


@pytest.mark.parametrize("distance", [0.0, 0.1, 0.6, -0.3, 5.0])
@pytest.mark.parametrize("hollow", [False, True])
@pytest.mark.parametrize("order", [2, 6])
def test_targets_along_normals(order, hollow, distance):
    """Targets X(u, v) + t n are at the bilinear map of (u, v), up to the centre of curvature of a hollow surface."""
    shape, name = (hollow_ball(2, 1.0, 1.5, order), "bottom") if hollow else (ball(1.0, 2, order), "outside")
    facets = Side.of(shape, 1, name, levels=1).facets
    uv = coordinates(len(facets))
    at = facets.at(uv)
    targets, axes = at.position + distance * at.normal, frames(facets)
    corners, places = places_in_planes(facets, targets, axes, None)
    size = np.sqrt(np.linalg.norm(facets.mean_outward, axis=1)).max()
    if hollow and distance > 1:  # beyond the centre: projected, and not far away
        assert np.isfinite(places).all() and np.abs(places).max() < 20 * size
        return
    # With normals of quadratics, far away, some have the foot point on the bilinear facet.
    part = 0.1 if order == 2 and distance > 0.5 else 1e-7
    assert np.abs(places - Bilinear(corners)(uv)).max() < part * size
    if distance == 0:
        assert np.abs(places - Bilinear(corners)(uv)).max() < 1e-13


@pytest.mark.parametrize("order", [1, 6])
def test_targets_along_a_direction(order):
    """The same along a direction."""
    facets = Side.of(hollow_ball(2, 1.0, 1.5, order), 1, "bottom", levels=1).facets
    direction = np.array([0.6, 0.0, 0.8])
    facets = facets[facets.mean_normal @ direction > 0.5]
    assert len(facets) > 5
    uv = coordinates(len(facets))
    targets = facets.at(uv).position + 3.0 * direction
    corners, places = places_in_planes(facets, targets, frames(facets), direction)
    assert np.abs(places - Bilinear(corners)(uv)).max() < 1e-10


@pytest.mark.parametrize("degrees", [0, 30])
def test_targets_far_beside_a_plane(degrees):
    """On a plane with distorted facets a place is the projection, however far it is."""

    def warped(x):
        return x[0] + 0.3 * x[1] * x[0] * (1 - x[0]), x[1] + 0.4 * x[0] * x[1] * (1 - x[1]), x[2]

    shape = block((0, 0, 0), (1, 1, 1), (3, 3, 1), 1).placed(warped).turned((1, 2, 3), degrees)
    facets = Side.of(shape, 1, "bottom").facets
    uv = coordinates(len(facets), -40, 40)
    inplane = facets.corners[:, 1:3] - facets.corners[:, :1]
    targets = facets.corners[:, :1] + uv @ inplane + 0.7 * facets.mean_normal[:, None]
    axes = frames(facets)
    _, places = places_in_planes(facets, targets, axes, None)
    origin = facets.corners.mean(axis=1)[:, None]
    assert np.abs(places - (targets - origin) @ axes.swapaxes(1, 2)).max() < 1e-9
