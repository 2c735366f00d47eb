"""Projection of points along lines onto a whole surface of root facets, curved and of any mesh.

Samples of the surface, with balls that cover it, are in search trees.  A line is followed from one ball to the next;
Newton's method finds where it meets the facets of the balls that it crosses.  Most points lie beside the surface: for
them the facet of the nearest sample is tried first.  All is local, and the cost of a point depends on the number of
facets by the depth of the trees only.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from fx_contact.geometry.root_facets import RootFacets
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int64Array, IntArray

#: Cosine of the angle between a line and the normal of a surface, below which they are taken for parallel: the gap
#: along the line would be ten times the distance.
LEAST_COSINE = 0.1
#: Part of a facet by which a point may be beyond its edge: rounding of Newton's method, so that no line passes between.
_EDGE = 1e-8
#: Samples along the shorter mean side of a facet, and at most along the longer one.
_SAMPLES, _MOST_SAMPLES = 3, 64
#: Balls are this much larger than half the diagonal of their part of a facet, for its curvature.
_COVER = 1.25
#: Samples near a position that are tried: a plane has pi 1.1^2 r^2 over the area of a part, at most 12 as radii of one
#: search tree differ by a factor of 2.
_NEAREST = 16
#: Lines inside a ball are followed in steps of this part of its radius: none passes between two positions.
_STRIDE = 0.5
#: Steps along a line; those along which it needs more run beside the surface, not into it.
_STEPS = 200


class Projected(NamedTuple):
    """Where lines from points x along n meet a surface.

    Attributes:
        facet: (...), position among the facets of the surface, -1 where none is met.
        uv: (..., 2), coordinates on the facet, in [0, 1].
        distance: (...), t with x + t n on the surface [m]; nan where none is met.
    """

    facet: Int64Array
    uv: FloatArray
    distance: FloatArray

    @property
    def found(self) -> BoolArray:
        """(...), points whose line meets the surface."""
        return np.asarray(self.facet >= 0)


class _Lines(NamedTuple):
    """Lines through points (k, 3) [m] along unit vectors (k, 3), and the farthest place behind that counts [m]."""

    points: FloatArray
    direction: FloatArray
    depth: float


class _Balls(NamedTuple):
    """Balls of one radius [m] around samples of facets: search tree, facet and coordinates of each."""

    radius: float
    tree: cKDTree
    facet: Int64Array
    uv: FloatArray


class SurfaceProjection:
    """A surface of root facets (n, 2) as (root cell, local face), sampled for projections onto it."""

    def __init__(self, mesh: RootMesh, facets: IntArray) -> None:
        self.facets = RootFacets(mesh, facets)
        self._balls = list(_sampled(self.facets))
        samples = np.concatenate([balls.tree.data for balls in self._balls])
        self._centre = (samples.min(axis=0) + samples.max(axis=0)) / 2
        largest = max(balls.radius for balls in self._balls)
        self._radius = np.linalg.norm(samples - self._centre, axis=1).max() + largest

    def __call__(self, points: FloatArray, direction: FloatArray, depth: float = np.inf) -> Projected:
        """Nearest place, ahead or behind, where the line through each point meets a facet that looks back along it.

        Args:
            points: (..., 3) [m]; the result has their shape.
            direction: (..., 3) or (3,), unit vectors, such as the outward normals of the other surface.
            depth: farthest place behind a point that counts [m].
        """
        shape = points.shape[:-1]
        points, direction = points.reshape(-1, 3), np.broadcast_to(direction, points.shape).reshape(-1, 3)
        result = self._beside(_Lines(points, direction, depth))
        left = np.flatnonzero(~result.found)
        if len(left):
            found = self._on_rays(_Lines(points[left], direction[left], depth))
            for column, values in zip(result, found):
                column[left] = values
        return Projected(result.facet.reshape(shape), result.uv.reshape(*shape, 2), result.distance.reshape(shape))

    def _beside(self, lines: _Lines) -> Projected:
        """Places on the facets of the nearest samples, not farther than their balls reach."""
        count = len(lines.points)
        queries = [balls.tree.query(lines.points) for balls in self._balls]
        which = np.argmin([distance for distance, _ in queries], axis=0)
        sample = np.array([number for _, number in queries])[which, np.arange(count)]
        facet, start, reach = np.empty(count, dtype=np.int64), np.empty((count, 2)), np.empty(count)
        for number, balls in enumerate(self._balls):
            ours = which == number
            facet[ours], start[ours], reach[ours] = balls.facet[sample[ours]], balls.uv[sample[ours]], balls.radius
        result = _none(count)
        near = np.flatnonzero(np.min([distance for distance, _ in queries], axis=0) <= reach)
        row, met, uv, t = self._met(lines, near, facet[near], start[near])
        good = np.abs(t) <= reach[row]
        row = row[good]
        result.facet[row], result.uv[row], result.distance[row] = met[good], uv[good], t[good]
        return result

    def _on_rays(self, lines: _Lines) -> Projected:
        """Places on all facets, found by following the lines."""
        (points, direction, depth), count = lines, len(lines.points)
        result = _none(count)
        from_centre = points - self._centre
        along = np.einsum("ki,ki->k", from_centre, direction)
        beside = np.sqrt(np.maximum(np.einsum("ki,ki->k", from_centre, from_centre) - along**2, 0.0))
        half = np.sqrt(np.maximum(self._radius**2 - beside**2, 0.0))
        # A ray a point and way, +1 ahead and -1 behind, from where it enters the sphere around the surface to its end.
        point, way = np.tile(np.arange(count), 2), np.repeat([1.0, -1.0], count)
        start, end = np.maximum(-way * along[point] - half[point], 0.0), -way * along[point] + half[point]
        end = np.where(way < 0, np.minimum(end, depth), end)
        rays = np.flatnonzero((beside[point] <= self._radius) & (start <= end))
        at = start
        for _ in range(_STEPS):
            if not len(rays):
                break
            ray_points, position = point[rays], way[rays] * at[rays]
            places = points[ray_points] + position[:, None] * direction[ray_points]
            free = np.full(len(rays), np.inf)
            for balls in self._balls:
                distance = self._meet(balls, lines, ray_points, places, result)
                stride = np.where(distance > 1.1 * balls.radius, distance - balls.radius, _STRIDE * balls.radius)
                free = np.minimum(free, stride)
            at[rays] += free
            rays = rays[at[rays] <= np.fmin(end[rays], np.abs(result.distance[point[rays]]))]
        return result

    def nearest(self, points: FloatArray) -> FloatArray:
        """Bounds (k,) of the distance of points (k, 3) to the surface [m]."""
        return np.min([balls.tree.query(points)[0] for balls in self._balls], axis=0)

    def _meet(
        self, balls: _Balls, lines: _Lines, rays: Int64Array, places: FloatArray, result: Projected
    ) -> FloatArray:
        """Enter what lines (k,) at some places (k, 3) meet in the balls around them; distances to samples (k,)."""
        known = min(_NEAREST, len(balls.facet))
        found = balls.tree.query(places, known)
        distance, sample = np.reshape(found[0], (-1, known)), np.reshape(found[1], (-1, known))
        facet = balls.facet[sample]
        fresh = distance <= 1.1 * balls.radius
        for column in range(1, known):  # each facet once, from its nearest sample
            fresh[:, column] &= (facet[:, :column] != facet[:, column : column + 1]).all(axis=1)
        row, nth = np.nonzero(fresh)
        row, facet, uv, t = self._met(lines, rays[row], facet[row, nth], balls.uv[sample[row, nth]])
        order = np.lexsort((np.abs(t), row))
        first = order[np.unique(row[order], return_index=True)[1]]
        first = first[~(np.abs(t[first]) >= np.abs(result.distance[row[first]]))]  # nan where nothing was met so far
        row = row[first]
        result.facet[row], result.uv[row], result.distance[row] = facet[first], uv[first], t[first]
        return np.asarray(distance[:, 0])

    def _met(
        self, lines: _Lines, row: Int64Array, facet: Int64Array, start: FloatArray
    ) -> tuple[Int64Array, Int64Array, FloatArray, FloatArray]:
        """Where lines, by their rows (k,), meet facets (k,) that face them: row, facet, uv and distance of these."""
        points, direction, depth = lines
        uv, met = self.facets.on_lines(facet, points[row, None], direction[row, None], start[:, None])
        met &= ((uv >= -_EDGE) & (uv <= 1 + _EDGE)).all(axis=2)
        row, facet, uv = row[met[:, 0]], facet[met[:, 0]], np.clip(uv[met[:, 0]], 0, 1)
        at = self.facets.at(facet, uv)
        t = np.einsum("ki,ki->k", at.position[:, 0] - points[row], direction[row])
        facing = np.einsum("ki,ki->k", at.normal[:, 0], direction[row]) < -LEAST_COSINE
        good = facing & (t >= -depth)
        return row[good], facet[good], uv[good, 0], t[good]


def _none(count: int) -> Projected:
    return Projected(np.full(count, -1), np.zeros((count, 2)), np.full(count, np.nan))


def _sampled(facets: RootFacets) -> list[_Balls]:
    """Balls that cover the facets, a set for each octave of radii, the largest first."""
    ends = np.array([[0, 0.5], [1, 0.5], [0.5, 0], [0.5, 1], [0.5, 0.5]])
    at = facets.at(np.arange(len(facets)), ends).position
    # Lengths through the middle, by way of it.
    lengths = np.linalg.norm(at[:, :4] - at[:, 4:], axis=2).reshape(-1, 2, 2).sum(axis=2)
    spacing = lengths.min(axis=1) / _SAMPLES
    spacing = np.maximum(spacing, lengths.max(axis=1) / _MOST_SAMPLES)
    counts = np.maximum(np.ceil(lengths / spacing[:, None]), 1).astype(np.int64)
    kinds, kind = np.unique(counts, axis=0, return_inverse=True)
    facet, uv, position, radius = [], [], [], []
    for number, (m, n) in enumerate(kinds):
        rows = np.flatnonzero(kind.ravel() == number)
        lattice = np.stack(np.meshgrid(np.arange(2 * m + 1) / (2 * m), np.arange(2 * n + 1) / (2 * n)), axis=-1)
        x = facets.at(rows, lattice.reshape(-1, 2)).position
        x = x.reshape(len(rows), 2 * n + 1, 2 * m + 1, 3)
        middle = x[:, 1::2, 1::2]
        corners = [x[:, i : i + 2 * n : 2, j : j + 2 * m : 2] for i in (0, 2) for j in (0, 2)]
        farthest = np.max([np.linalg.norm(corner - middle, axis=3) for corner in corners], axis=0)
        facet.append(np.repeat(rows, m * n))
        uv.append(np.tile(lattice[1::2, 1::2].reshape(-1, 2), (len(rows), 1)))
        position.append(middle.reshape(-1, 3))
        radius.append(np.repeat(_COVER * farthest.reshape(len(rows), -1).max(axis=1), m * n))
    sizes = np.concatenate(radius)
    octave = np.round(np.log2(sizes)).astype(np.int64)
    parts = [np.flatnonzero(octave == number) for number in np.unique(octave)[::-1]]
    facet_of, uv_of, place = (np.concatenate(list(values)) for values in (facet, uv, position))
    return [_Balls(sizes[part].max(), cKDTree(place[part]), facet_of[part], uv_of[part]) for part in parts]
