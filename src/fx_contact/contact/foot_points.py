"""Foot points on first facets: the points X(u, v) from which targets are at X + t n, n the normal or a direction.

All is local.
"""

import numpy as np

from fx_contact.contact.polygons import Bilinear
from fx_contact.geometry.leaf_facets import CORNERS, LeafFacets
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int64Array

#: Steps of Newton's method; fewer are taken unless the second surface is near the centre of curvature of the first.
_STEPS = 10
#: Newton's method has converged after a step below this part of a facet, for its last steps gain five digits or more.
_STEP = 1e-8
#: Longest step, in facets: second facets may be that much larger.
_FAR = 100.0
#: Part of a root facet by which its bilinear map may be off: corners farther out are not looked for on it.
_MARGIN = 0.1
#: Corners beyond an edge of a root facet by this part of it are on the edge: rounding.
_EDGE = 1e-9


def places_in_planes(
    first: LeafFacets, targets: FloatArray, axes: FloatArray, direction: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """Places in planes across `axes` (k, 2, 3) of the corners of facets (k,) and of targets (k, m, 3): two (k, ., 2).

    Local.  The place of a target is the bilinear map of the coordinates of its foot point.  X is the curved facet as
    far as its root facet reaches; beyond, it and the normal are bilinear between the corners, as no polynomial is
    continued.  Targets without foot point are projected along the mean normal.
    """
    ends = first.at(np.broadcast_to(CORNERS, (len(first), 4, 2)))
    normals = ends.normal if direction is None else np.broadcast_to(direction, ends.position.shape)
    origin = ends.position.mean(axis=1)[:, None]
    corners, projected = ((x - origin) @ axes.swapaxes(1, 2) for x in (ends.position, targets))
    plane, fan = Bilinear(corners), _Fan(Bilinear(ends.position), Bilinear(normals))
    uv, found = fan.foot_points(targets)
    places = np.where(found[..., None], plane(uv), projected)
    if direction is not None and first.root.order == 1:  # the facets are bilinear
        return corners, places
    low, high = (value[:, None] for value in first.root_range)
    margin = _MARGIN * (high - low)
    row, target = np.nonzero(found & ((uv >= low - margin) & (uv <= high + margin)).all(axis=2))
    low, high, edge = low[row], high[row], _EDGE * (high - low)[row]
    start = np.clip(uv[row, target, None], low, high)
    curved, near = fan[row].foot_points(targets[row, target, None], first[row], start)
    near &= ((curved >= low - edge) & (curved <= high + edge)).all(axis=2)
    place = np.where(near[..., None], plane[row](curved), places[row, target, None])
    places[row, target] = place[:, 0]
    return corners, places


class _Fan:
    """Facets (k,) and their normals, both bilinear between the corners."""

    def __init__(self, surface: Bilinear, normals: Bilinear) -> None:
        self._surface, self._normals = surface, normals

    def __getitem__(self, rows: Int64Array) -> "_Fan":
        return _Fan(self._surface[rows], self._normals[rows])

    def foot_points(
        self, targets: FloatArray, facets: LeafFacets | None = None, start: FloatArray | None = None
    ) -> tuple[FloatArray, BoolArray]:
        """Coordinates (k, m, 2) of the foot points of targets (k, m, 3), and (k, m) those found.

        On the bilinear facets, or on curved ones, where Newton's method has the curvature of the bilinear normals.
        """
        uv = np.full((*targets.shape[:2], 2), 0.5) if start is None else start
        step = np.full(uv.shape, np.inf)
        t = np.einsum("kmi,kmi->km", targets - self._surface(uv), self._normals(uv))[..., None]
        for _ in range(_STEPS):
            normal, turns = self._normals(uv), self._normals.slopes(uv)
            if facets is None:
                position, slopes = self._surface(uv), self._surface.slopes(uv)
            else:
                at = facets.at(uv)
                position, slopes = at.position, (at.first, at.second)
                normal = normal if (turns[0] == 0).all() and (turns[1] == 0).all() else at.normal
            along_u, along_v = (slope + t * turn for slope, turn in zip(slopes, turns))
            away = targets - position - t * normal
            with np.errstate(all="ignore"):  # beyond the centre of curvature nothing is found
                scale = _triple(normal, along_u, along_v)
                step_u = _triple(away, along_v, normal) / scale
                step_v = _triple(away, normal, along_u) / scale
                step_t = _triple(away, along_u, along_v) / scale
            step = np.nan_to_num(np.concatenate([step_u, step_v], axis=2), nan=np.inf)
            finite = np.isfinite(step).all(axis=2, keepdims=True) & np.isfinite(step_t)
            uv, t = uv + np.where(finite, np.clip(step, -_FAR, _FAR), 0), t + np.where(finite, step_t, 0)
            if np.abs(step).max(initial=0.0) < _STEP:
                break
        return uv, (np.abs(step) < _STEP).all(axis=2)


def _triple(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Triple products (k, m, 1) of vectors (k, m, 3)."""
    return np.asarray(np.einsum("kmi,kmi->km", a, np.cross(b, c))[..., None])
