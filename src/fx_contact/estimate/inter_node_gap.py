"""The gap between the nodes of contact facets, and penetration there, which node pairs do not resist.

Node-to-node contact has the gap at nodes alone.  A round body that approaches a facet by less than the distance of its
nodes is not stopped at all; and between closed pairs unlike surfaces penetrate or gape, as a sphere on coarse facets.
The estimate xi has no part of this: it is of the strains of the discrete solution.
"""

from copy import copy

import numpy as np
import numpy.typing as npt
from scipy.integrate import simpson

from fx_contact.problem import hexahedron

#: Penetration up to this part of what the gap varies by on a facet may come from the linear solver: its tolerance,
_VARIATION = 1e-8
#: and up to this part of the facet's size, the root of its area, from rounding: of a facet in 1e6 along a body.
_ROUNDING = 1e-9
#: Parts along each side of a facet at whose ends the least gap is looked for.  Of a round gap it misses penetrations up
#: to 1/4096 of what the gap varies by on the facet.
_PARTS = 64
#: Facets that are looked at together, so that memory does not grow with their number.
_CHUNK = 64


class GapBetweenNodes:
    """The gap g between the nodes of contact facets, beside g_I, bilinear between neighbouring nodes.

    Collective on state.forest.comm.  Away from closed pairs any penetration counts.  On closed facets, and those next
    to them, g differs from g_I on any mesh of a round body.  Quadratic displacements follow a round gap, but not a
    pressure that ends within a facet: g_I of their own degree would see no error in a contact of one node.

    Args:
        state: SolvedState.
    """

    def __init__(self, state):
        self._state, self._parts = state, []
        forest, pairs, solution = state.forest, state.pairs, state.solution
        prolongation, space = pairs.prolongation, pairs.prolongation.space
        for kind in pairs.kinds:
            leaf, face = kind.facets(forest)
            cells, ours = space.on_faces(leaf, face), pairs.contact == kind.index
            near = _touched(prolongation, cells, pairs.first[ours & solution.active])
            facets = _Facets(kind, space, leaf, face, _known(state, ours)[cells])
            self._parts.append((leaf, cells, ours, near, facets))

    def penetrated(self):
        """Leaves with a facet that is penetrated between nodes that stay apart: (n,) bool.  Local."""
        refine = np.zeros(len(self._state.forest), dtype=bool)
        for leaf, _, _, near, facets in self._parts:
            refine[leaf[~near][facets.where(~near).penetrate()]] = True
        return refine

    def on_cells(self, pressure):
        """int |p| |g - g_I| dA over the closed facets of each cell of the mesh: (ncells,) float64.

        Collective.

        Args:
            pressure: (n,) float64, p at this rank's node pairs.
        """
        state = self._state
        of_leaf = np.zeros(len(state.forest))
        for leaf, cells, ours, near, facets in self._parts:
            nodal = _at_nodes(state.pairs, ours, np.abs(pressure)[:, None])[cells][near, :, 0]
            np.add.at(of_leaf, leaf[near], facets.where(near).work(nodal))
        return of_leaf[state.elasticity.leaf_mesh.leaf]


class _Facets:
    """Facets of first surfaces and what they face, in points enough for the order of the root mesh and the degree.

    Local.

    Args:
        kind: RowKind of their contact.
        space: Space.
        leaf, face: (n,) int64, leaves and their local faces.
        nodal: (n, (p+1)^2, 6) float64, the jump of the displacement at their nodes [m], and normals.
    """

    def __init__(self, kind, space, leaf, face, nodal):
        forest, degree = space.forest, space.degree
        parts = 2 * ((max(forest.mesh.order, degree + 1) + 1) // 2)  # even, for Simpson's rule
        line = np.linspace(0, 1, parts + 1)
        bilinear, self._shape = (_tensor(order, line) for order in (1, degree))
        hats = np.stack([np.interp(line, np.linspace(0, 1, degree + 1), row) for row in np.eye(degree + 1)], axis=1)
        self._linear = np.kron(hats, hats)  # between neighbouring nodes
        nodes = np.arange(degree + 1) * parts // degree
        self._nodes = ((parts + 1) * nodes[:, None] + nodes).ravel()  # positions of the nodes among the points
        self._simpson = _simpson(parts + 1)
        # How far a function may leave the range of its samples, relative to that: less than by Lebesgue's constant.
        self._swing = np.abs(hexahedron.lagrange(parts, np.linspace(0, 1, 101))).sum(axis=1).max() ** 2
        anchors = forest.corners[leaf[:, None], hexahedron.FACE_CORNERS[face]]
        points = np.einsum("pv,nvi->npi", np.rint(parts**2 * bilinear).astype(np.int64), anchors)
        points = points / parts**2
        here, apart = forest.evaluate(forest.cell[leaf], points), kind.apart(forest, leaf, face, points)
        diagonals = here[:, -1] - here[:, 0], here[:, parts] - here[:, -parts - 1]
        self._area = np.linalg.norm(np.cross(*diagonals), axis=1) / 2
        jump, self._normal = np.split(self._sampled(nodal), 2, axis=2)
        self._apart = apart - jump  # small, however far the bodies come

    def where(self, which):
        """Some of the facets: _Facets.  Args: which: (n,) bool."""
        some = copy(self)
        some._area, some._apart, some._normal = self._area[which], self._apart[which], self._normal[which]
        return some

    def _sampled(self, nodal):
        """Values at the nodes, (n, (p+1)^2, ...), at all points: (n, points, ...) float64."""
        return np.einsum("pv,nv...->np...", self._shape, nodal)

    def penetrate(self):
        """Whether facets penetrate more than at their nodes, and than may come from rounding: (n,) bool."""
        gap = _along(self._apart, self._normal)
        limit = np.minimum(gap[:, self._nodes].min(axis=1), 0.0) - _ROUNDING * np.sqrt(self._area)
        limit -= _VARIATION * np.ptp(gap, axis=1)
        deeper = gap.min(axis=1) < self._swing * np.ptp(gap, axis=1)
        deeper[deeper] = _least(self._apart[deeper], self._normal[deeper]) < limit[deeper]
        return deeper

    def work(self, pressure):
        """int max(p, 0) |g - g_I| dA: (n,) float64.  Args: pressure: (n, (p+1)^2) float64, p at the nodes."""
        gap = _along(self._apart, self._normal)
        off = np.abs(gap - gap[:, self._nodes] @ self._linear.T) - _ROUNDING * np.sqrt(self._area)[:, None]
        return self._area * ((np.maximum(self._sampled(pressure), 0.0) * np.maximum(off, 0.0)) @ self._simpson)


def _tensor(order, x):
    """Lagrange functions of a facet's nodes at a grid of points: (k^2, (p+1)^2) float64, first coordinate fastest."""
    line = hexahedron.lagrange(order, x)
    return np.kron(line, line)


def _simpson(count):
    """Simpson's rule on a facet of area 1, for so many points a side: (count^2,) float64."""
    line = simpson(np.eye(count), dx=1 / (count - 1))
    return np.outer(line, line).ravel()


def _touched(prolongation, cells, closed):
    """Facets with a closed node, and those that share a node with one: (n,) bool.

    Collective.

    Args:
        prolongation: Prolongation.
        cells: (n, (p+1)^2) int, nodes of the facets.
        closed: (k,) int, closed conforming nodes.
    """
    for _ in range(2):
        touched = prolongation.zeros(1)
        touched[closed] = 1.0
        facets = (prolongation.prolong(prolongation.summed(touched))[cells, 0] != 0).any(axis=1)
        closed = prolongation.conforming[np.unique(cells[facets])]
        closed = closed[closed >= 0]
    return facets


def _known(state, ours):
    """Jumps of the displacement and normals of some rows, at this rank's nodes: (m, 6) float64.  Collective."""
    pairs = state.pairs
    return _at_nodes(pairs, ours, np.column_stack([pairs.closing(state.solution.displacement), pairs.normal]))


def _at_nodes(pairs, ours, values):
    """Values (n, k) of some rows at this rank's nodes of the first surface: (m, k) float64.  Collective."""
    prolongation = pairs.prolongation
    said = prolongation.zeros(values.shape[1])
    said[pairs.first[ours]] = values[ours]
    return prolongation.prolong(prolongation.summed(said))


def _least(apart: npt.NDArray[np.float64], normal: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """The least gap on each facet, at a grid of points: (n,) [m].

    Args:
        apart: (n, m^2, 3), at m x m points of each facet, first coordinate fastest, to the point across [m].
        normal: (n, m^2, 3), of any length, likewise.
    """
    side = int(np.sqrt(apart.shape[1]))
    finer = hexahedron.lagrange(side - 1, np.linspace(0, 1, _PARTS + 1))

    def at(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """At the points of the grid."""
        grid = values.reshape(-1, side, side, 3)
        return np.einsum("qy,pynj->qpnj", finer, np.einsum("px,nyxj->pynj", finer, grid))

    least = np.empty(len(apart))
    for start in range(0, len(least), _CHUNK):
        some = slice(start, start + _CHUNK)
        least[some] = _along(at(apart[some]), at(normal[some])).min(axis=(0, 1))
    return least


def _along(apart: npt.NDArray[np.float64], normal: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """The component of vectors along normals of any length: (..., 3) to (...)."""
    return np.einsum("...i,...i->...", apart, normal) / np.linalg.norm(normal, axis=-1)
