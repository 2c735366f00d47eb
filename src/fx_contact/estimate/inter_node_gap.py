"""The gap between the nodes of contact facets, and penetration there, which node pairs do not resist.

Node-to-node contact has the gap at nodes alone.  A round body that approaches a facet by less than the distance of its
nodes is not stopped at all; and between closed pairs unlike surfaces penetrate or gape, as a sphere on coarse facets.
The estimate xi has no part of this: it is of the strains of the discrete solution.
"""

from copy import copy

import numpy as np

from fx_contact.contact.contact_facets import facets_of, positions_across
from fx_contact.problem import hexahedron

#: Penetration up to this part of what the gap varies by on a facet may come from the linear solver,
_VARIATION = 1e-8
#: and up to this part of the facet's size, the root of its area, from rounding.
_ROUNDING = 1e-9
#: Columns of what is known at the nodes of a contact facet.
_PRESSURE, _MODULUS, _JUMP, _NORMAL = 0, 1, slice(2, 5), slice(5, 8)
#: Parts of the grid of a first look at a facet for each part of the sampled one.
_FINER = 4
#: How often a grid around a valley moves or halves: valleys a hundred times as long as wide are found to 1e-9 with 28.
_STEPS = 32
#: Facets that are looked at together, so that memory does not grow with their number.
_CHUNK = 1024


def inter_node_penetration(state, tolerance, patches, energy):
    """Leaves to refine because bodies penetrate or gape between the nodes of their contact facets.

    Collective on state.forest.comm.  Away from closed pairs any penetration counts.  On the facets of a contact patch
    the gap g differs from g_I, bilinear between neighbouring nodes, on any mesh of a round body.  Quadratic
    displacements follow a round gap, but not a pressure that ends within a facet: g_I of their own degree would see no
    error in a contact of one node.  With the pressure p and the penetration o = max(-g - max(-g_I, 0), 0) beyond that
    of the nodes, its energy is

        int p |g - g_I| + (E*/h) o^2 dA.

    Each patch may have e^2 of the energy that it stores, or what the linear solver leaves.  Where it has more, its
    facets with more than their share are refined.

    Args:
        state: SolvedState.
        tolerance: prescribed accuracy e [-].
        patches: ContactPatches of the closed pairs.
        energy: (patches.number,) float64, twice the energy that each patch stores [J].

    Returns:
        (n,) bool, for this rank's leaves, on the first surfaces alone.
    """
    forest, pairs, solution = state.forest, state.pairs, state.solution
    refine, allowed = np.zeros(len(forest), dtype=bool), np.maximum(tolerance**2 * energy, solution.energy_error**2)
    sums, closed = np.zeros((2, patches.number)), []
    for index, patch in enumerate(patches.facet):
        leaf, face = facets_of(index, forest)
        nodal = _at_nodes(pairs, solution, index)[pairs.prolongation.space.on_faces(leaf, face)]
        near, facets = patch >= 0, _Facets(pairs.prolongation.space, leaf, face, nodal)
        refine[leaf[~near][facets.where(~near).penetrate()]] = True
        leaf, patch, own = leaf[near], patch[near], facets.where(near).energy()
        np.add.at(sums, (0, patch), own)
        np.add.at(sums, (1, patch), own > 0)
        closed.append((leaf, patch, own))
    total, count = forest.comm.allreduce(sums)
    for leaf, patch, own in closed:
        refine[leaf[(total > allowed)[patch] & (own > (allowed / np.maximum(count, 1))[patch])]] = True
    return refine


class _Facets:
    """Contact facets and those that face them, in points enough for the order of the root mesh and the degree.

    Local.

    Args:
        space: Space.
        leaf, face: (n,) int64, leaves and their local faces.
        nodal: (n, (p+1)^2, 8) float64, columns of what is known at their nodes.
    """

    def __init__(self, space, leaf, face, nodal):
        forest, degree = space.forest, space.degree
        parts = 2 * ((max(forest.mesh.order, degree + 1) + 1) // 2)  # even, for Simpson's rule
        self._count, self._nodal, self._orientation = parts + 1, nodal, hexahedron.FACE_ORIENTATION[face]
        line = np.linspace(0, 1, self._count)
        bilinear, self._shape = (_tensor(order, line) for order in (1, degree))
        hats = np.stack([np.interp(line, np.linspace(0, 1, degree + 1), row) for row in np.eye(degree + 1)], axis=1)
        self._linear = np.kron(hats, hats)  # between neighbouring nodes
        anchors = forest.corners[leaf[:, None], hexahedron.FACE_CORNERS[face]]
        points = np.einsum("pv,nvi->npi", np.rint(parts**2 * bilinear).astype(np.int64), anchors)
        nodes = np.arange(degree + 1) * parts // degree
        self._nodes = (self._count * nodes[:, None] + nodes).ravel()  # positions of the nodes among the points
        # How far a function may leave the range of its samples, relative to that: less than by Lebesgue's constant.
        self._swing = np.abs(hexahedron.lagrange(parts, np.linspace(0, 1, 101))).sum(axis=1).max() ** 2
        self._here, self._there = positions_across(forest, leaf, face, points / parts**2)
        diagonals = self._here[:, -1] - self._here[:, 0], self._here[:, parts] - self._here[:, -parts - 1]
        self._area = np.linalg.norm(np.cross(*diagonals), axis=1) / 2

    def where(self, which):
        """Some of the facets: _Facets.  Args: which: (n,) bool."""
        some = copy(self)
        for name in ("_nodal", "_orientation", "_here", "_there", "_area"):
            setattr(some, name, getattr(self, name)[which])
        return some

    def _sampled(self, columns):
        """A column, or some, of what is known at the nodes, at all points: (n, points, ...) float64."""
        return np.einsum("pv,nv...->np...", self._shape, self._nodal[:, :, columns])

    def _gap(self):
        """The gap at all points along normals between those of the nodes: (n, points) float64 [m]."""
        normal = self._sampled(_NORMAL)
        apart = self._there - self._here - self._sampled(_JUMP)  # small, however far the bodies come
        return np.einsum("npi,npi->np", normal, apart) / np.linalg.norm(normal, axis=2)

    def penetrate(self):
        """Whether facets penetrate more than at their nodes, and than may come from rounding: (n,) bool."""
        sampled = self._gap()
        some = sampled.min(axis=1) < self._swing * np.ptp(sampled, axis=1)
        few = self.where(some)
        gap = FacetGap(few._here, few._there, few._sampled(_JUMP), few._orientation)
        y, x = np.array(np.divmod(self._nodes, self._count)) / (self._count - 1)
        nodes = gap.at(x, y).min(axis=1)
        limit = np.minimum(nodes, 0.0) - _VARIATION * np.ptp(sampled[some], axis=1) - _ROUNDING * np.sqrt(few._area)
        some[some] = gap.least(limit) < limit
        return some

    def energy(self):
        """The integral of `inter_node_penetration`, twice an energy: (n,) float64 [J]."""
        gap, size = self._gap(), np.sqrt(self._area)
        at_nodes, rounding = gap[:, self._nodes], _ROUNDING * size[:, None]
        off = np.maximum(np.abs(gap - at_nodes @ self._linear.T) - rounding, 0.0)
        # The penetration at the nodes is that of a penalty, and has a bound of its own.
        beyond = np.maximum(-gap - np.maximum(-at_nodes, 0.0) @ self._linear.T - rounding, 0.0)
        pressure, modulus = np.maximum(self._sampled(_PRESSURE), 0.0), self._sampled(_MODULUS)
        return self._area * ((pressure * off + modulus / size[:, None] * beyond**2) @ _simpson(self._count))


def _tensor(order, x):
    """Lagrange functions of a facet's nodes at a grid of points: (k^2, (p+1)^2) float64, first coordinate fastest."""
    line = hexahedron.lagrange(order, x)
    return np.kron(line, line)


def _simpson(count):
    """Simpson's rule on a facet of area 1, for so many points a side: (count^2,) float64."""
    line = np.full(count, 2.0)
    line[1::2], line[[0, -1]] = 4.0, 1.0
    line /= line.sum()
    return np.outer(line, line).ravel()


def _at_nodes(pairs, solution, index):
    """Columns of what is known of a contact pair's node pairs, at this rank's nodes: (m, 8) float64."""
    prolongation, ours = pairs.prolongation, pairs.contact == index
    said = prolongation.zeros(8)
    modulus, u = 1 / (1 / pairs.modulus).sum(axis=1), prolongation.ghosted(solution.displacement)
    jump = u[pairs.first] - u[pairs.second]
    columns = solution.pressure, modulus, *jump.T, *pairs.normal.T
    said[pairs.first[ours]] = np.stack(columns, axis=1)[ours]
    return prolongation.prolong(prolongation.summed(said))


class FacetGap:
    """The gap between facing facets as a function on them, along the normal of the surface midway between them.

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
        """The least gap on each facet, by finer and finer grids around all valleys of one.

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
            bottoms = part.where(facet)._descended(grid[:, point], values[facet, point], line[1])
            least[some] = values.min(axis=1)
            np.minimum.at(least[some], facet, bottoms)
        return least

    def where(self, which):
        """The FacetGap of some of the facets, by a slice or by position."""
        some = copy(self)
        for name in ("_orientation", "_apart", "_midway"):
            setattr(some, name, getattr(self, name)[which])
        return some

    def _descended(self, place, least, width):
        """The least values that finer and finer grids find from a place on each facet, (2, n), where it is (n,)."""
        y, x = np.mgrid[-1:1:5j, -1:1:5j].reshape(2, -1, 1)
        width = np.full(len(least), width)
        for _ in range(_STEPS):
            x_y = np.clip(place[:, None] + width * np.stack([x, y]), 0, 1)  # (2, 25, n)
            values = self.at(*x_y.swapaxes(1, 2))
            best = values.argmin(axis=1)
            value = values[np.arange(len(best)), best]
            lower = value < least
            place = np.where(lower, x_y[:, best, np.arange(len(best))], place)
            least, width = np.minimum(value, least), np.where(lower, width, width / 2)
        return least


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
