"""The gap between facing facets as a function on them, and its least value."""

from copy import copy

import numpy as np

from fx_contact.problem import hexahedron

#: Parts that the grid of a first look has for each part of the sampled one.
_FINER = 4
#: Distance of the points of difference quotients, in the facet's coordinates, and Newton's steps.
_STENCIL, _STEPS = 1 / 1024, 8
#: How far Newton's first step may go, in parts of that grid.
_TRUST = 2
#: Facets that are looked at together, so that memory does not grow with their number.
_CHUNK = 1024


class Gap:
    """The gap between facing facets, along the normal of the surface midway between them.

    Surfaces of polynomials of the order m - 1, or less, are taken as they are.  Local.

    Args:
        here, there: (n, m^2, 3) float64, positions in a regular grid on each facet, and of the points that face them,
            first coordinate fastest [m].
        jump: (n, m^2, 3) float64, displacement here less that there [m].
        orientation: (n,) int, 1 where the normal by the facet's coordinates points from here to there, else -1.
    """

    def __init__(self, here, there, jump, orientation):
        side = int(np.sqrt(here.shape[1]))
        self._order, self._orientation = side - 1, orientation[:, None]
        self._apart = (there - here - jump).reshape(-1, side, side, 3)
        self._midway = (here + there).reshape(-1, side, side, 3) / 2

    def at(self, x, y):
        """The gap at k points of each facet.

        Args:
            x, y: (n, k) float64, coordinates on the facets, in [0, 1]; (k,) for the same on all.

        Returns:
            (n, k) float64 [m].
        """
        (along_x, slope_x), (along_y, slope_y) = (
            (hexahedron.lagrange(self._order, t), hexahedron.lagrange_derivative(self._order, t)) for t in (x, y)
        )
        normal = np.cross(_product(slope_x, along_y, self._midway), _product(along_x, slope_y, self._midway))
        apart = _product(along_x, along_y, self._apart)
        return self._orientation * np.einsum("npi,npi->np", normal, apart) / np.linalg.norm(normal, axis=2)

    def least(self, limit=np.inf):
        """The least gap on each facet, by Newton's method from all valleys of a grid.

        Args:
            limit: (n,) float64 or float, what is of interest: valleys that will not come below it are left out [m].

        Returns:
            (n,) float64 [m], of what was looked at.
        """
        least, limit = np.empty(len(self._apart)), np.broadcast_to(limit, len(self._apart))
        line = np.linspace(0, 1, _FINER * self._order + 1)
        grid = np.stack(np.meshgrid(line, line)).reshape(2, -1)
        for start in range(0, len(least), _CHUNK):
            some = slice(start, start + _CHUNK)
            part = self.where(some)
            values = part.at(*grid)
            facet, point = _valleys(values.reshape(-1, len(line), len(line)), limit[some])
            bottoms = part.where(facet)._descended(grid[:, point], values[facet, point], _TRUST * line[1])
            least[some] = values.min(axis=1)
            np.minimum.at(least[some], facet, bottoms)
        return least

    def where(self, which):
        """The Gap of some of the facets, by a slice or by position."""
        some = copy(self)
        for name in ("_orientation", "_apart", "_midway"):
            setattr(some, name, getattr(self, name)[which])
        return some

    def _descended(self, place, least, trust):
        """Newton's method from one place on each facet, (2, n), where the gap is (n,), to the values at its end."""
        trust = np.full(len(least), trust)
        for _ in range(_STEPS):
            step = self._step(place, np.maximum(-place, -trust), np.minimum(1 - place, trust))
            value = self.at(*(place + step)[:, :, None])[:, 0]
            lower = value < least
            place, least = np.where(lower, place + step, place), np.minimum(value, least)
            trust = np.where(lower, trust, trust / 4)
        return least

    def _step(self, place, low, high):
        """To the least value of a parabola around one place on each facet, within a box: (2, n) float64."""
        y, x = (offset.ravel()[:, None] * _STENCIL for offset in np.mgrid[-1:2, -1:2])
        around = self.at((place[0] + x).T, (place[1] + y).T).reshape(-1, 3, 3)
        slope = np.stack([around[:, 1, 2] - around[:, 1, 0], around[:, 2, 1] - around[:, 0, 1]]) / (2 * _STENCIL)
        bend = np.stack([around[:, 1] @ [1, -2, 1], around[:, :, 1] @ [1, -2, 1]]) / _STENCIL**2
        twist = (around[:, 2, 2] - around[:, 2, 0] - around[:, 0, 2] + around[:, 0, 0]) / (4 * _STENCIL**2)
        candidates = [_stationary(slope, bend, twist, low, high)]
        for one in (0, 1):
            for end in (low, high):
                edge = end.copy()
                down = -(slope[one] + twist * end[1 - one])
                edge[one] = _divided(down, bend[one], np.where(down > 0, high[one], low[one]))
                candidates.append(edge.clip(low, high))
        candidates = np.stack(candidates)
        model = (slope * candidates + bend * candidates**2 / 2).sum(axis=1) + twist * candidates.prod(axis=1)
        return candidates[model.argmin(axis=0), :, np.arange(len(twist))].T


def _valleys(values, limit):
    """Where a grid (n, m, m) has its local minima, if what they may hide is below a limit: facets, and points there.

    Between the points of a parabola it falls by less than to the lowest of them from the highest one around.
    """
    m = values.shape[1]
    wide = np.pad(values, ((0, 0), (1, 1), (1, 1)), constant_values=np.inf)
    around = np.stack([wide[:, i : i + m, j : j + m] for i, j in np.ndindex(3, 3) if (i, j) != (1, 1)])
    lowest = (values < around[:4]).all(axis=0) & (values <= around[4:]).all(axis=0)  # one of several that are equal
    highest = np.where(np.isfinite(around), around, values).max(axis=0)
    facet, *point = np.nonzero(lowest & (2 * values - highest < limit[:, None, None]))
    return facet, point[0] * m + point[1]


def _product(along_x, along_y, nodal):
    """Values of tensor products at points of each facet: (n, k, 3) float64."""
    return np.einsum("...px,...pxi->...pi", along_x, np.einsum("...py,...yxi->...pxi", along_y, nodal))


def _stationary(slope, bend, twist, low, high):
    """Where a convex parabola is least, within a box; its middle, 0, where it is not convex: (2, n) float64."""
    determinant = bend.prod(axis=0) - twist**2
    convex = (determinant > 0) & (bend[0] > 0)
    place = np.stack([twist * slope[1] - bend[1] * slope[0], twist * slope[0] - bend[0] * slope[1]])
    place = np.where(convex, np.divide(place, determinant, out=np.zeros_like(place), where=convex), 0.0)
    return np.where((place >= low) & (place <= high), place, 0.0)


def _divided(down, bend, end):
    """Where a parabola in one direction is least: at its vertex, or at the end that it falls to."""
    return np.divide(down, bend, out=end.copy(), where=bend > 0)
