"""Quadrature over segments, the parts of first facets that face one second facet, of two surfaces meshed apart.

Points of the first surface are projected onto the second along their normals, or along the direction of the contact.
Each first facet has a plane, in which it is the quadrilateral of its corners; a point with coordinates (u, v) is at the
bilinear map of (u, v) there, so that segments which cover the quadrilateral cover the curved facet.  Corners of the
second facet are at the places of their foot points on the first.  The intersection of both quadrilaterals is cut into
triangles (Puso, Laursen, CMAME 193, 2004).

On planes with straight edges everything is exact up to rounding, and so it is on curved surfaces meshed alike, hanging
nodes included.  On others edges of the second facet are replaced by straight lines: a point may be on the continuation
of its facet beyond an edge, by a part of the facet that falls with its size.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import basix
import numpy as np

from fx_contact.contact.foot_points import places_in_planes
from fx_contact.contact.polygons import Bilinear, clipped, signed_areas, triangles
from fx_contact.geometry.leaf_facets import CORNERS, LeafFacets
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int64Array
from fx_contact.surfaces.surface_projection import LEAST_COSINE

#: Pairs of facets at once: 2000 have 100,000 points at degree 2.
_CHUNK = 2000
#: Triangles below this part of the smaller facet's area are dropped: less than the rounding of the areas.
_SLIVER = 1e-15
#: Part of a facet's side by which points may be beyond the edges of the second facet.
_BEYOND = 0.5
#: Facets are flat with straight edges if they differ from their corners' bilinear map by this part of their size.
_FLAT = 1e-9
#: Highest degree of a rule, and digits by which rules for distorted quadrilaterals are chosen.  Integrals of functions
#: on a warped plane of 3 x 3 and 4 x 3 facets (`test_segments`) are off by 2e-11 with 8 digits, 1e-13 with 10 and 3e-16
#: with 13 on an AMD EPYC; with 10 by less than 1e-14 on an Intel Xeon.
_MOST, _DIGITS = 30, 10
#: Ends of the counter-clockwise sides among corners with u fastest.
_AROUND = np.array([0, 1, 3, 2])


@dataclass(frozen=True, eq=False)
class Segments:
    """Points of the quadrature over pairs of facets.

    Attributes:
        pair: (n,), ascending.
        first, second: (n, 2), coordinates on the leaf facets; those on the second may be outside of [0, 1].
        weight: (n,), area of the first surface [m^2].
        position: (n, 3), on the first surface [m].
        apart: (n, 3), from there to the second surface, along the first normal or the direction [m].
        first_normal, second_normal: (n, 3), unit normals out of the bodies [-].
    """

    pair: Int64Array
    first: FloatArray
    second: FloatArray
    weight: FloatArray
    position: FloatArray
    apart: FloatArray
    first_normal: FloatArray
    second_normal: FloatArray


def create_segments(
    first: LeafFacets, second: LeafFacets, degree: int, depth: float, direction: FloatArray | None = None
) -> Iterator[Segments]:
    """Segments of pairs of leaf facets (k,), some at a time, for products of functions of two facets.  Local.

    Pairs that lie apart, only touch or look the same way have none.

    Args:
        degree: of the displacements.
        depth: second facets farther behind the first surface are ignored [m]; inf: none.
        direction: (3,), unit vector out of the first body; None: the normals of the first surface.
    """
    for start in range(0, len(first), _CHUNK):
        part = slice(start, start + _CHUNK)
        meeting = _Intersections(first[part], second[part], direction)
        rules = meeting.degrees(4 * degree)
        found = [meeting.points(rules == rule, int(rule), depth) for rule in np.unique(rules)]
        columns = [np.concatenate(column) for column in zip(*found)] if found else []
        if columns:
            order = np.argsort(columns[0], kind="stable")
            pair, *others = (column[order] for column in columns)
            yield Segments(pair + start, *others)


class _Intersections:
    """Triangles of the intersections of pairs of facets (k,) that face each other.

    Attributes:
        pair: (t,), of each triangle.
    """

    def __init__(self, first: LeafFacets, second: LeafFacets, direction: FloatArray | None) -> None:
        along = first.mean_normal if direction is None else np.broadcast_to(direction, (len(first), 3))
        cosine = np.stack([_cosine(first, along), -_cosine(second, along)])
        self._facing = np.flatnonzero((cosine > LEAST_COSINE).all(axis=0))
        self._first, self._second, self._direction = first[self._facing], second[self._facing], direction
        axes = _axes(along[self._facing])
        quads = places_in_planes(self._first, self._second.corners, axes, direction)
        self._maps = [Bilinear(quad) for quad in quads]
        one, two = (_counter_clockwise(quad[:, _AROUND]) for quad in quads)
        polygons, count = clipped(two, one)
        least = _SLIVER * np.minimum(np.abs(signed_areas(one)), np.abs(signed_areas(two)))
        pair, corners = triangles(polygons, count)
        area = signed_areas(corners)
        kept = np.abs(area) > least[pair]
        self.pair, self._corners, self._area = pair[kept], corners[kept], area[kept]

    def degrees(self, least: int) -> Int64Array:
        """Degree of the rule for each triangle (t,): `least`, or for flat distorted facets what keeps `_DIGITS`."""
        digits = np.min([_digits(quad) for quad in self._maps], axis=0)
        more = np.minimum(_DIGITS / digits, _MOST - least).astype(np.int64)
        flat = _flat(self._first) & _flat(self._second)
        return np.asarray((least + np.where(flat, more, 0))[self.pair])

    def points(self, some: BoolArray, degree: int, depth: float) -> tuple[Int64Array | FloatArray, ...]:
        """Columns of `Segments` of some triangles (t,), by a rule of a degree."""
        barycentric, weights = _rule(degree)
        pair, count = self.pair[some], len(weights)
        plane = barycentric @ self._corners[some]
        one, two = (bilinear[pair] for bilinear in self._maps)
        uv = one.inverse(plane)
        here = self._first[pair].at(uv)
        weight = self._area[some, None] * weights * here.jacobian / np.abs(one.determinant(uv))
        normal = here.normal
        along = normal if self._direction is None else np.broadcast_to(self._direction, normal.shape)
        other, found = self._second[pair].on_lines(here.position, along, two.inverse(plane))
        there = self._second[pair].at(np.clip(other, -_BEYOND, 1 + _BEYOND))
        apart, facing = there.position - here.position, there.normal
        good = found & (np.abs(other - 0.5) <= 0.5 + _BEYOND).all(axis=2)
        good &= np.einsum("tmi,tmi->tm", facing, along) < 0
        good &= np.einsum("tmi,tmi->tm", apart, along) >= -depth
        pairs = np.repeat(self._facing[pair], count).reshape(good.shape)
        columns = pairs, uv, other, weight, here.position, apart, normal, facing
        return tuple(column[good] for column in columns)


def _cosine(facets: LeafFacets, along: FloatArray) -> FloatArray:
    """Of the angle between the mean normals of facets and unit vectors (k, 3): (k,)."""
    return np.asarray(np.einsum("ki,ki->k", facets.mean_normal, along))


def _axes(along: FloatArray) -> FloatArray:
    """Two unit vectors (k, 2, 3) across unit vectors (k, 3), a right-handed frame with them."""
    other = np.eye(3)[np.abs(along).argmin(axis=1)]
    one = np.cross(other, along)
    one /= np.linalg.norm(one, axis=1)[:, None]
    return np.stack([one, np.cross(along, one)], axis=1)


def _counter_clockwise(polygons: FloatArray) -> FloatArray:
    """Polygons (k, n, 2), those that run clockwise turned round."""
    return np.where((signed_areas(polygons) < 0)[:, None, None], polygons[:, ::-1], polygons)


def _flat(facets: LeafFacets) -> BoolArray:
    """Facets (k,) that are flat with straight edges, where their map is that of their corners."""
    v, u = np.divmod(np.arange(9), 3)
    uv = np.broadcast_to(np.stack([u, v], axis=1) / 2, (len(facets), 9, 2))
    u, v = uv[..., 0], uv[..., 1]
    bilinear = np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v], axis=2) @ facets.corners
    twist = facets.corners - facets.corners.mean(axis=1)[:, None]
    away = np.abs(np.einsum("kci,ki->kc", twist, facets.mean_normal)).max(axis=1)
    away = np.maximum(away, np.abs(facets.at(uv).position - bilinear).max(axis=(1, 2)))
    return np.asarray(away < _FLAT * np.linalg.norm(facets.mean_outward, axis=1) ** 0.5)


def _digits(quads: Bilinear) -> FloatArray:
    """Digits that a degree more of a rule gains for functions of the bilinear coordinates of quadrilaterals: (k,).

    Coordinates are analytic up to where the determinant of the map is zero: polynomials of degree n approximate them
    with an error of rho^-n, rho that of Bernstein's ellipse through the zero (Trefethen, Approximation Theory, 2013).
    """
    determinant = np.abs(quads.determinant(CORNERS[None]))
    low, high = determinant.min(axis=1), determinant.max(axis=1)
    zero = (high + low) / np.maximum(high - low, 1e-16 * high)
    return np.maximum(np.log10(zero + np.sqrt(zero**2 - 1)), 0.1)


@cache
def _rule(degree: int) -> tuple[FloatArray, FloatArray]:
    """Barycentric points (g, 3) and weights (g,), of sum 1, of a rule for triangles."""
    points, weights = map(np.asarray, basix.make_quadrature(basix.CellType.triangle, degree))
    return np.column_stack([1 - points.sum(axis=1), points]), 2 * weights
