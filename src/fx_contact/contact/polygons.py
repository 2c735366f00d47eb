"""Polygons of a plane, many at once: intersections of quadrilaterals, their triangles, and bilinear coordinates.

All is local.
"""

import numpy as np

from fx_contact.parallel.arrays import BoolArray, FloatArray, Int64Array, IntArray

#: Steps of Newton's method for bilinear coordinates: 4 in a square, 7 where the Jacobian varies by a factor of 10.
_STEPS = 12
#: Bilinear coordinates are wanted in [0, 1] and are kept within this distance of it.
_BEYOND = 0.5


def signed_areas(polygons: FloatArray) -> FloatArray:
    """Areas (k,) of polygons with vertices (k, n, 2), positive where they run counter-clockwise.  Local."""
    from_first = polygons[:, 1:] - polygons[:, :1]
    return np.asarray(_cross(from_first[:, :-1], from_first[:, 1:]).sum(axis=1) / 2)


def clipped(subject: FloatArray, window: FloatArray) -> tuple[FloatArray, Int64Array]:
    """Intersections of polygons (k, n, 2) with convex quadrilaterals (k, 4, 2), both counter-clockwise.  Local.

    Sutherland and Hodgman, Comm. ACM 17, 1974.  A polygon that is not convex has parts of area zero.

    Returns:
        vertices (k, m, 2), padded at the end, and the number of vertices (k,), 0 of polygons that lie apart.
    """
    count: Int64Array = np.full(len(subject), subject.shape[1])
    for edge in range(4):
        corner, along = window[:, edge], window[:, (edge + 1) % 4] - window[:, edge]
        height = _cross(along[:, None], subject - corner[:, None])
        place = np.arange(subject.shape[1])
        real = place < count[:, None]
        after = np.where(place + 1 < count[:, None], place + 1, 0)
        height_after = np.take_along_axis(height, after, axis=1)
        inside, inside_after = height >= 0, height_after >= 0
        crosses = real & (inside != inside_after)
        part = np.divide(height, height - height_after, out=np.zeros_like(height), where=crosses)
        step = np.take_along_axis(subject, after[:, :, None], axis=1) - subject
        vertices = np.stack([subject, subject + part[:, :, None] * step], axis=2)
        subject, count = _compressed(vertices, np.stack([real & inside, crosses], axis=2))
    return subject, count


def _compressed(vertices: FloatArray, kept: BoolArray) -> tuple[FloatArray, Int64Array]:
    """Vertices (k, n, 2, 2) with those that are kept (k, n, 2) in front, (k, m, 2), and their numbers (k,)."""
    k, n = kept.shape[:2]
    vertices, kept = vertices.reshape(k, 2 * n, 2), kept.reshape(k, 2 * n)
    count = kept.sum(axis=1)
    order = np.argsort(~kept, axis=1, kind="stable")[:, : count.max(initial=1)]
    return np.take_along_axis(vertices, order[:, :, None], axis=1), count


def triangles(polygons: FloatArray, count: Int64Array) -> tuple[Int64Array, FloatArray]:
    """Triangles that share the first vertex of each polygon: polygons (t,) and corners (t, 3, 2).  Local."""
    polygon, after = np.nonzero(np.arange(2, max(polygons.shape[1], 2)) < count[:, None])
    corners = np.stack([np.zeros_like(after), after + 1, after + 2], axis=1)
    return polygon, polygons[polygon[:, None], corners]


class Bilinear:
    """Bilinear maps of [0, 1]^2 by the images (k, 4, d) of its corners, u fastest.

    Coordinates (k, m, 2) may be outside of [0, 1].
    """

    def __init__(self, corners: FloatArray) -> None:
        a, b, c, d = (corners[:, i, None] for i in range(4))
        self._corners, self._low, self._u, self._v, self._uv = corners, a, b - a, c - a, d - c - b + a

    def __getitem__(self, rows: IntArray) -> "Bilinear":
        return Bilinear(self._corners[rows])

    def __call__(self, uv: FloatArray) -> FloatArray:
        """Points (k, m, d)."""
        u, v = uv[..., :1], uv[..., 1:]
        return np.asarray(self._low + self._u * u + self._v * v + self._uv * (u * v))

    def slopes(self, uv: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives by u and by v: two (k, m, d)."""
        u, v = uv[..., :1], uv[..., 1:]
        return self._u + self._uv * v, self._v + self._uv * u

    def determinant(self, uv: FloatArray) -> FloatArray:
        """(k, m), d = 2, negative where the map turns the square over."""
        return _cross(*self.slopes(uv))

    def inverse(self, points: FloatArray) -> FloatArray:
        """Coordinates (k, m, 2), in or near [0, 1], of points (k, m, 2)."""
        uv = np.full(points.shape, 0.5)
        for _ in range(_STEPS):
            away, (along_u, along_v) = points - self(uv), self.slopes(uv)
            with np.errstate(all="ignore"):  # a degenerate quadrilateral has no area
                step = np.stack([_cross(away, along_v), _cross(along_u, away)], axis=-1)
                step = np.nan_to_num(step / _cross(along_u, along_v)[..., None])
            uv = np.clip(uv + step, -_BEYOND, 1 + _BEYOND)
            if np.abs(step).max(initial=0.0) < 1e-9:  # quadratic convergence
                break
        return uv


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
