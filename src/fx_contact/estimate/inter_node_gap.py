"""Gap and penetration between the nodes of contact facets.

Node-to-node contact resists penetration at nodes alone.  A round body may pass between open nodes; between closed ones
unlike surfaces penetrate or gape, as a sphere on coarse facets.  The estimate xi is of strains, and shows none of it.
"""

from copy import copy

import numpy as np
from scipy.integrate import simpson

from fx_contact.contact.constraint_rows import ConstraintRows, RowKind
from fx_contact.estimate.solved_state import SolvedState
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int64Array, IntArray
from fx_contact.problem import hexahedron

#: Penetrations up to this part of the variation of the gap on a facet are errors of the linear solver: its tolerance,
_VARIATION = 1e-8
#: or up to this part of the facet's size, the root of its area, rounding: of a facet in 1e6 along a body.
_ROUNDING = 1e-9
#: Parts of each side of a facet in the sampling of the least gap.  Of a round gap it misses penetrations up to 1/4096
#: of the variation of the gap on the facet.
_PARTS = 64
#: Facets that are sampled together: a bound of memory.
_CHUNK = 64


class GapBetweenNodes:
    """The gap g between the nodes of contact facets, beside g_I, bilinear between neighbouring nodes.

    Collective on state.forest.comm.  Away from closed rows any penetration counts.  On closed facets, and those next
    to them, g differs from g_I on any mesh of a round body.  Quadratic displacements follow a round gap, but not a
    pressure that ends within a facet: g_I of their own degree would see no error in a contact of one node.

    Args:
        state: with rows.
    """

    def __init__(self, state: SolvedState) -> None:
        forest, pairs, solution = state.forest, state.pairs, state.solution
        assert pairs is not None
        self._forest, self._rows, self._leaf = forest, pairs, state.elasticity.leaf_mesh.leaf
        self._parts: list[tuple[Int64Array, IntArray, BoolArray, BoolArray, _Facets]] = []
        prolongation, space = pairs.prolongation, pairs.prolongation.space
        for kind in pairs.kinds:
            leaf, face = kind.facets(forest)
            cells, ours = space.on_faces(leaf, face), pairs.contact == kind.index
            near = _touched(prolongation, cells, pairs.first[ours & solution.active])
            facets = _Facets(kind, space, leaf, face, _known(pairs, solution.displacement, ours)[cells])
            self._parts.append((leaf, cells, ours, near, facets))

    def penetrated(self) -> BoolArray:
        """Leaves with a facet that is penetrated between open nodes: (n,).  Local."""
        refine = np.zeros(len(self._forest), dtype=bool)
        for leaf, _, _, near, facets in self._parts:
            refine[leaf[~near][facets.where(~near).penetrate()]] = True
        return refine

    def on_cells(self, pressure: FloatArray) -> FloatArray:
        """int |p| |g - g_I| dA over the closed facets of each cell: (ncells,), by p in the rows (n,).  Collective."""
        of_leaf = np.zeros(len(self._forest))
        for leaf, cells, ours, near, facets in self._parts:
            nodal = _at_nodes(self._rows, ours, np.abs(pressure)[:, None])[cells][near, :, 0]
            np.add.at(of_leaf, leaf[near], facets.where(near).work(nodal))
        return of_leaf[self._leaf]


class _Facets:
    """Gap vectors and normals of facets at points enough for the order of the root mesh and the degree.

    Local.

    Args:
        kind: of their contact.
        leaf, face: (n,), leaves and their local faces on the first surface.
        nodal: (n, (p+1)^2, 6), the jump of the displacement at their nodes [m], and normals.
    """

    def __init__(self, kind: RowKind, space: Space, leaf: Int64Array, face: Int64Array, nodal: FloatArray) -> None:
        forest, degree = space.forest, space.degree
        parts = 2 * ((max(forest.mesh.order, degree + 1) + 1) // 2)  # even, for Simpson's rule
        line = np.linspace(0, 1, parts + 1, dtype=np.float64)
        bilinear, self._shape = (_tensor(order, line) for order in (1, degree))
        hats = np.stack([np.interp(line, np.linspace(0, 1, degree + 1), row) for row in np.eye(degree + 1)], axis=1)
        self._linear = np.kron(hats, hats)  # between neighbouring nodes
        nodes = np.arange(degree + 1) * parts // degree
        self._nodes = ((parts + 1) * nodes[:, None] + nodes).ravel()  # positions of the nodes among the points
        self._simpson = _simpson(parts + 1)
        # A function leaves the range of its samples by less than Lebesgue's constant times this range.
        self._swing = np.abs(hexahedron.lagrange(parts, np.linspace(0, 1, 101))).sum(axis=1).max() ** 2
        anchors = forest.corners[leaf[:, None], hexahedron.FACE_CORNERS[face]]
        points = np.einsum("pv,nvi->npi", np.rint(parts**2 * bilinear).astype(np.int64), anchors)
        points = points / parts**2
        here, apart = forest.evaluate(forest.cell[leaf], points), kind.apart(forest, leaf, face, points)
        diagonals = here[:, -1] - here[:, 0], here[:, parts] - here[:, -parts - 1]
        self._area = np.linalg.norm(np.cross(*diagonals), axis=1) / 2
        jump, self._normal = np.split(self._sampled(nodal), 2, axis=2)
        self._apart = apart - jump  # small, however far the bodies come

    def where(self, which: BoolArray) -> "_Facets":
        """Some of the facets, by a mask (n,)."""
        some = copy(self)
        some._area, some._apart, some._normal = self._area[which], self._apart[which], self._normal[which]
        return some

    def _sampled(self, nodal: FloatArray) -> FloatArray:
        """Interpolation of nodal values (n, (p+1)^2, ...): (n, points, ...)."""
        return np.einsum("pv,nv...->np...", self._shape, nodal)

    def penetrate(self) -> BoolArray:
        """Facets with more penetration than at their nodes, and than rounding: (n,)."""
        gap = _normal_part(self._apart, self._normal)
        limit = np.minimum(gap[:, self._nodes].min(axis=1), 0.0) - _ROUNDING * np.sqrt(self._area)
        limit -= _VARIATION * np.ptp(gap, axis=1)
        deeper: BoolArray = gap.min(axis=1) < self._swing * np.ptp(gap, axis=1)
        deeper[deeper] = _least(self._apart[deeper], self._normal[deeper]) < limit[deeper]
        return deeper

    def work(self, pressure: FloatArray) -> FloatArray:
        """int max(p, 0) |g - g_I| dA by nodal p (n, (p+1)^2): (n,)."""
        gap = _normal_part(self._apart, self._normal)
        off = np.abs(gap - gap[:, self._nodes] @ self._linear.T) - _ROUNDING * np.sqrt(self._area)[:, None]
        work: FloatArray = self._area * (
            (np.maximum(self._sampled(pressure), 0.0) * np.maximum(off, 0.0)) @ self._simpson
        )
        return work


def _tensor(order: int, x: FloatArray) -> FloatArray:
    """Lagrange functions of a facet's nodes at a grid of points: (k^2, (p+1)^2), first coordinate fastest."""
    line = hexahedron.lagrange(order, x)
    return np.asarray(np.kron(line, line), np.float64)


def _simpson(count: int) -> FloatArray:
    """Simpson's rule on a facet of area 1, for so many points a side: (count^2,)."""
    line = simpson(np.eye(count), dx=1 / (count - 1))
    return np.asarray(np.outer(line, line).ravel())


def _touched(prolongation: Prolongation, cells: IntArray, closed: IntArray) -> BoolArray:
    """Facets, by their nodes (n, (p+1)^2), with a closed conforming node, and their neighbours: (n,).  Collective."""
    facets = np.zeros(len(cells), dtype=bool)
    for _ in range(2):
        touched = prolongation.zeros(1)
        touched[closed] = 1.0
        facets = (prolongation.prolong(prolongation.summed(touched))[cells, 0] != 0).any(axis=1)
        closed = prolongation.conforming[np.unique(cells[facets])]
        closed = closed[closed >= 0]
    return facets


def _known(rows: ConstraintRows, u: FloatArray, ours: BoolArray) -> FloatArray:
    """Jumps of the displacement and normals of some rows, at this rank's nodes: (m, 6).  Collective."""
    return _at_nodes(rows, ours, np.column_stack([rows.closing(u), rows.normal]))


def _at_nodes(rows: ConstraintRows, ours: BoolArray, values: FloatArray) -> FloatArray:
    """Values (n, k) of some rows at this rank's nodes of the first surface: (m, k).  Collective."""
    prolongation = rows.prolongation
    nodal = prolongation.zeros(values.shape[1])
    nodal[rows.first[ours]] = values[ours]
    return prolongation.prolong(prolongation.summed(nodal))


def _least(apart: FloatArray, normal: FloatArray) -> FloatArray:
    """The least gap on each facet, at a grid of points: (n,) [m].

    Args:
        apart: (n, m^2, 3), at m x m points of each facet, first coordinate fastest, to the point across [m].
        normal: (n, m^2, 3), of any length, likewise.
    """
    side = int(np.sqrt(apart.shape[1]))
    finer = hexahedron.lagrange(side - 1, np.linspace(0, 1, _PARTS + 1))

    def at(values: FloatArray) -> FloatArray:
        """At the points of the grid."""
        grid = values.reshape(-1, side, side, 3)
        return np.einsum("qy,pynj->qpnj", finer, np.einsum("px,nyxj->pynj", finer, grid))

    least = np.empty(len(apart))
    for start in range(0, len(least), _CHUNK):
        some = slice(start, start + _CHUNK)
        least[some] = _normal_part(at(apart[some]), at(normal[some])).min(axis=(0, 1))
    return least


def _normal_part(apart: FloatArray, normal: FloatArray) -> FloatArray:
    """The component of vectors along normals of any length: (..., 3) to (...)."""
    return np.asarray(np.einsum("...i,...i->...", apart, normal) / np.linalg.norm(normal, axis=-1))
