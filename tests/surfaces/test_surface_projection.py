"""Projection along lines onto whole surfaces: planes, round ones from inside and outside, borders, steps, any mesh."""

import numpy as np
import pytest
from model_problems import scramble

from fx_contact.geometry.root_facets import RootFacets
from fx_contact.geometry.shapes import root_mesh_from_shapes, rotation
from fx_contact.geometry.solids import ball, block, cylinder, ring
from fx_contact.surfaces.surface_projection import LEAST_COSINE, SurfaceProjection

pytestmark = pytest.mark.ranks(1)


def draw(count, width, salt=0):
    """Numbers (count, width) in [0, 1)."""
    return np.stack([scramble(np.arange(count), salt + k) / 2.0**64 for k in range(width)], axis=1)


def directions(count, salt=0):
    """Unit vectors (count, 3)."""
    x = draw(count, 3, salt) - 0.5
    return x / np.linalg.norm(x, axis=1)[:, None]


def surface(name, **shapes):
    mesh = root_mesh_from_shapes(shapes)
    return mesh, mesh.surfaces[name]


def met(projection, projected, points, direction):
    """Points on the surface, which are x + t n, and the normals there."""
    there = projected.found
    at = projection.facets.at(projected.facet[there], projected.uv[there, None])
    line = points + projected.distance[:, None] * direction
    assert np.abs(at.position[:, 0] - line[there]).max() < 1e-13 * (1 + np.nanmax(np.abs(projected.distance)))
    assert ((projected.uv >= 0) & (projected.uv <= 1)).all()
    assert np.isnan(projected.distance[~there]).all()
    return at.position[:, 0], at.normal[:, 0]


@pytest.mark.parametrize("order", [1, 2, 3, 6])
@pytest.mark.parametrize("distance", [1e-6, 0.3, 9.0, -0.2])
def test_ball_from_outside(order, distance):
    """Lines towards the centre: every one meets the sphere, up to the error of its geometry."""
    mesh, facets = surface("ball outside", ball=ball(1.0, 2, order))
    projection = SurfaceProjection(mesh, facets)
    inward = -directions(2000)
    points = -(1 + distance) * inward
    projected = projection(points, inward)
    assert projected.found.all()
    position, _ = met(projection, projected, points, inward)
    error = np.abs(np.linalg.norm(position, axis=1) - 1).max()
    assert error < {1: 0.08, 2: 5e-3, 3: 5e-4, 6: 1e-6}[order]
    assert np.abs(projected.distance - distance).max() <= error + 1e-13


@pytest.mark.parametrize("order", [1, 2, 6])
def test_bore_from_inside(order):
    """A pin in a bore with much play: outward lines meet the bore on their own side."""
    mesh, facets = surface("ring inside", ring=ring(2.0, 3.0, 1.0, (1, 2, 1), order))
    projection = SurfaceProjection(mesh, facets)
    angle, z = 2 * np.pi * draw(1000, 1)[:, 0], draw(1000, 1, 5)[:, 0]
    outward = np.stack([np.cos(angle), np.sin(angle), 0 * z], axis=1)
    for radius in (0.01, 1.0, 1.999, 2.5):
        points = radius * outward + z[:, None] * [0, 0, 1]
        projected = projection(points, outward)
        assert projected.found.all()
        assert np.abs(projected.distance - (2 - radius)).max() < {1: 0.16, 2: 0.01, 6: 1e-6}[order]
    assert not projection(points, outward, depth=0.3).found.any()  # 0.5 behind
    assert projection(points, outward, depth=0.7).found.all()


def test_tilted_plane_along_a_direction():
    """Oblique lines onto a tilted plane: where the plane's equation has them, and not beyond its border."""
    turn = rotation((1.0, 2.0, 0.5), 37.0)
    mesh, facets = surface(
        "floor top", floor=block((-1, -1, -1), (1, 1, 0), (5, 3, 1), 3).turned((1.0, 2.0, 0.5), 37.0)
    )
    projection = SurfaceProjection(mesh, facets)
    local = np.column_stack([3 * draw(4000, 2) - 1.5, 0.1 + draw(4000, 1, 4)])
    points, direction = local @ turn.T, np.array([0.3, 0.2, -1.0]) @ turn.T / np.sqrt(1.13)
    projected = projection(points, direction)
    t = local[:, 2] * np.sqrt(1.13)
    target = local[:, :2] + local[:, 2:] * [0.3, 0.2]
    inside = (np.abs(target) <= 1).all(axis=1)
    assert 0.2 < inside.mean() < 0.8
    assert np.array_equal(projected.found, inside)
    assert np.abs(projected.distance - t)[inside].max() < 1e-13
    assert not projection(points, -direction, depth=0.0).found.any()
    assert not projection(points, np.array([1.0, 0.0, 0.0]) @ turn.T).found.any()  # along the plane


def test_border_and_edges_are_met():
    """Lines through the corners and edges of facets, inner ones and those on the border, meet the surface."""
    mesh, facets = surface("floor top", floor=block((0, 0, -1), (1, 1, 0), (3, 3, 1), 2))
    corners = mesh.facet_points(facets, order=4).reshape(-1, 3)
    projected = SurfaceProjection(mesh, facets)(corners + [0, 0, 0.7], np.array([0.0, 0.0, -1.0]))
    assert projected.found.all() and np.abs(projected.distance - 0.7).max() < 1e-14


@pytest.mark.parametrize("order", [1, 2, 3])
def test_all_facets_one_by_one(order):
    """Random lines through a graded surface of blocks, a cylinder and a ball: as if every facet were tried."""
    shapes = {
        "plate": block((-3, -3, -2), (3, 3, -1.5), (1, 2, 1), order),
        "ball": ball(0.9, 2, order),
        "rod": cylinder(0.3, 2.0, (1, 8), order).shifted(2, 0, -1),
        "crumbs": block((-2, -2, -1), (-1.8, -1.8, -0.9), (6, 6, 1), order),
    }
    sides = ["plate top", "ball outside", "rod outside", "rod top", "crumbs top", "crumbs left"]
    mesh = root_mesh_from_shapes(shapes, {"all": sides})
    facets = mesh.surfaces["all"]
    projection, count = SurfaceProjection(mesh, facets), 300
    assert len(projection._balls) >= 3
    points, direction = 8 * draw(count, 3) - 4, directions(count, 5)
    points[::3], direction[::3] = [-1.9, -1.9, 2] + 0.5 * (draw(count, 3) - 0.5)[::3], [0, 0, -1.0]
    projected = projection(points, direction)
    every, (row, facet) = RootFacets(mesh, facets), np.divmod(np.arange(count * len(facets)), len(facets))
    uv, found = every.on_lines(facet, points[row, None], direction[row, None], np.full((len(row), 1, 2), 0.5))
    at = every.at(facet, uv)
    t = np.einsum("ki,ki->k", at.position[:, 0] - points[row], direction[row])
    looks = np.einsum("ki,ki->k", at.normal[:, 0], direction[row]) < -LEAST_COSINE
    good = found[:, 0] & ((uv >= -1e-8) & (uv <= 1 + 1e-8)).all(axis=(1, 2)) & looks
    nearest = np.where(good, np.abs(t), np.inf).reshape(count, -1).min(axis=1)
    assert 0.3 < np.isfinite(nearest).mean() < 0.95
    assert np.array_equal(projected.found, np.isfinite(nearest))
    assert np.abs(np.abs(projected.distance) - nearest)[projected.found].max() < 1e-12


def test_cost_does_not_grow_with_the_mesh(monkeypatch):
    """Facets tried for each point: on 20,000 facets as on 10."""
    tried, original = [], RootFacets.on_lines

    def counted(self, facet, *arguments):
        tried.append(len(facet))
        return original(self, facet, *arguments)

    monkeypatch.setattr(RootFacets, "on_lines", counted)
    costs = {}
    for cells in ((5, 2, 1), (200, 100, 1)):
        mesh, facets = surface("floor top", floor=block((0, 0, -1), (2, 1, 0), cells, 1))
        assert len(facets) == cells[0] * cells[1]
        projection = SurfaceProjection(mesh, facets)
        for height in (0.0, 0.01, 3.0):
            tried.clear()
            points = np.column_stack([draw(2000, 2) * [2, 1], np.full(2000, height)])
            assert projection(points, np.array([0.0, 0.0, -1.0])).found.all()
            costs[cells, height] = sum(tried) / 2000
    assert max(costs.values()) < 12 and max(costs.values()) < 6 * min(costs.values()), costs
