"""Gap and penetration between the nodes of contact facets: neither constrained node to node nor estimated by xi."""

import numpy as np

from fx_contact.contact.constraint_rows import RowKind
from fx_contact.estimate.solved_state import SolvedState
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.geometry import hexahedron
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int64Array, IntArray
from fx_contact.parallel.mpi import together

#: Penetrations up to this part of the variation of the gap on a facet are errors of the linear solver (its tolerance),
_VARIATION = 1e-8
#: up to this part of the root of the facet's area rounding (of a facet in 1e6 along a body).
_ROUNDING = 1e-9
#: Facets that are sampled together, for memory.
_CHUNK = 64


class GapBetweenNodes:
    """The gap g between the nodes of contact facets, and g_I, bilinear between neighbouring nodes at either degree.

    Collective on state.forest.comm.  On closed facets and their neighbours g - g_I times a pressure counts, on others
    any penetration.  Rows of integrals have none of the former.

    Args:
        state: with rows.
    """

    def __init__(self, state: SolvedState) -> None:
        forest, pairs, solution = state.forest, state.contact_rows, state.solution
        self._forest, self._rows, self._leaf = forest, pairs, state.elasticity.leaf_mesh.leaf
        self._open: list[tuple[Int64Array, _Facets]] = []
        self._closed: list[tuple[int, Int64Array, IntArray, _Facets]] = []
        prolongation, space = pairs.prolongation, pairs.prolongation.space
        known = np.column_stack([pairs.closing(solution.displacement), pairs.normal, np.ones(len(pairs))])
        for kind in pairs.kinds:
            leaf, face = kind.facets(forest)
            cells, closed = space.on_faces(leaf, face), solution.active & (pairs.contact == kind.index)
            near = _touched(prolongation, cells, pairs.first[closed])
            nodal = pairs.at_nodes(kind.index, known)[cells]
            far = ~near & nodal[..., 6].any(axis=1)  # not beyond the cover of a second surface
            nodal = _continued(nodal)
            near &= not kind.INTEGRATED
            with together(forest.comm):
                away, close = (_Facets(kind, space, leaf[at], face[at], nodal[at]) for at in (far, near))
            self._open.append((leaf[far], away))
            self._closed.append((kind.index, leaf[near], cells[near], close))

    def penetrated(self) -> BoolArray:
        """Leaves with a facet that is penetrated between open nodes: (n,).  Collective."""
        refine = np.zeros(len(self._forest), dtype=bool)
        with together(self._forest.comm):
            for leaf, facets in self._open:
                refine[leaf[facets.penetrate()]] = True
        return refine

    def on_cells(self, pressure: FloatArray) -> FloatArray:
        """int |p| |g - g_I| dA over the closed facets of each cell: (ncells,), by p in the rows (n,).  Collective."""
        of_leaf = np.zeros(len(self._forest))
        for contact, leaf, cells, facets in self._closed:
            nodal = self._rows.at_nodes(contact, np.abs(pressure)[:, None])[cells, 0]
            np.add.at(of_leaf, leaf, facets.work(nodal))
        return of_leaf[self._leaf]


class _Facets:
    """Gap vectors and normals of facets (n,) at points enough for the order of the root mesh and the degree.

    By the jumps of the displacement [m] and normals at their nodes (n, (p+1)^2, 6).
    """

    def __init__(self, kind: RowKind, space: Space, leaf: Int64Array, face: Int64Array, nodal: FloatArray) -> None:
        forest, degree = space.forest, space.degree
        parts = 2 * ((max(forest.mesh.order, degree + 1) + 1) // 2)  # even, for Simpson's rule
        bilinear, self._shape = (hexahedron.face_interpolation(order, parts) for order in (1, degree))
        self._linear = hexahedron.bilinear_interpolation(degree, parts)
        nodes = np.arange(degree + 1) * parts // degree
        self._nodes = ((parts + 1) * nodes[:, None] + nodes).ravel()  # among the points
        self._simpson = _simpson(parts + 1)
        # How far the gap leaves the range of its samples, over this range: by Lebesgue's constant of a polynomial, else
        # as a quadratic function with its minimum in the middle between samples.
        constant = np.abs(hexahedron.lagrange(parts, np.linspace(0, 1, 101))).sum(axis=1).max()
        self._swing = 2 / parts**2 if kind.INTEGRATED else constant**2
        anchors = forest.corners[leaf[:, None], hexahedron.FACE_CORNERS[face]]
        points = np.einsum("pv,nvi->npi", np.rint(parts**2 * bilinear).astype(np.int64), anchors)
        points = points / parts**2
        here, apart = forest.evaluate(forest.cell[leaf], points), kind.apart(forest, leaf, face, points)
        diagonals = here[:, -1] - here[:, 0], here[:, parts] - here[:, -parts - 1]
        self._area = np.linalg.norm(np.cross(*diagonals), axis=1) / 2
        jump, self._normal = np.split(self._sampled(nodal), 2, axis=2)
        self._apart = apart - jump  # small, however far the bodies come
        size = np.linalg.norm(np.ptp(forest.mesh.points, axis=0))
        self._beyond = kind.INTEGRATED & (np.linalg.norm(apart, axis=2) > 1.5 * size)  # as `MortarRows.apart_from`
        self._kind, self._here, self._jump = kind, here, jump

    def _sampled(self, nodal: FloatArray) -> FloatArray:
        """Nodal values (n, (p+1)^2, ...) at the points: (n, points, ...)."""
        return np.einsum("pv,nv...->np...", self._shape, nodal)

    def penetrate(self) -> BoolArray:
        """Facets that penetrate more than at their nodes and than rounding: (n,)."""
        gap = _normal_part(self._apart, self._normal) + self._kind.contact.clearance
        largest = np.where(self._beyond, -np.inf, gap).max(axis=1, keepdims=True)
        gap = np.where(self._beyond & np.isfinite(largest), largest, gap)
        limit = -_ROUNDING * np.sqrt(self._area) - _VARIATION * np.ptp(gap, axis=1)
        if not self._kind.INTEGRATED:  # rows of integrals may be open where nodes penetrate
            limit += np.minimum(gap[:, self._nodes].min(axis=1), 0.0)
        deeper: BoolArray = gap.min(axis=1) < self._swing * np.ptp(gap, axis=1)
        # Beyond a rim the gap may fall by as much as the facet is wide, at 45 degrees.
        deeper |= self._beyond.any(axis=1) & (gap.min(axis=1) < np.sqrt(self._area))
        deeper[deeper] = self._least(np.flatnonzero(deeper)) < limit[deeper]
        return deeper

    def _least(self, facets: Int64Array) -> FloatArray:
        """The least gap (k,) [m] of facets (k,) on a grid on each."""
        side = int(np.sqrt(self._apart.shape[1]))
        finer = hexahedron.face_interpolation(side - 1, self._kind.PARTS)
        least = np.empty(len(facets))
        for start in range(0, len(least), _CHUNK):
            some = facets[start : start + _CHUNK]
            position, normal = finer @ self._here[some], finer @ self._normal[some]
            apart = self._kind.apart_from(position.reshape(-1, 3), normal.reshape(-1, 3))
            if apart is None:
                apart = finer @ self._apart[some]
            else:
                apart = apart.reshape(position.shape) - finer @ self._jump[some]
            least[start : start + _CHUNK] = _normal_part(apart, normal).min(axis=1)
        return least + self._kind.contact.clearance

    def work(self, pressure: FloatArray) -> FloatArray:
        """int max(p, 0) |g - g_I| dA by nodal p (n, (p+1)^2): (n,)."""
        gap = _normal_part(self._apart, self._normal)  # and a constant clearance
        off = np.abs(gap - gap[:, self._nodes] @ self._linear.T) - _ROUNDING * np.sqrt(self._area)[:, None]
        density = np.maximum(self._sampled(pressure), 0.0) * np.maximum(off, 0.0)
        return self._area * (density @ self._simpson)


def _continued(nodal: FloatArray) -> FloatArray:
    """Values (n, (p+1)^2, k) of rows at the nodes of facets, without a row the mean of the others of the facet.

    The last column has the share of nodes with a row: part of the masters of a hanging node may have none.
    """
    share = nodal[..., -1:]
    values = np.divide(nodal[..., :-1], share, out=np.zeros_like(nodal[..., :-1]), where=share != 0)
    mean = values.sum(axis=1, keepdims=True) / np.maximum((share != 0).sum(axis=1, keepdims=True), 1)
    return np.where(share != 0, values, mean)


def _simpson(count: int) -> FloatArray:
    """Simpson's rule on a facet of area 1, for so many points a side, an odd number: (count^2,)."""
    weights = np.ones(count)
    weights[1:-1:2], weights[2:-1:2] = 4, 2
    weights /= 3 * (count - 1)
    return np.asarray(np.kron(weights, weights), dtype=np.float64)


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


def _normal_part(apart: FloatArray, normal: FloatArray) -> FloatArray:
    """The component (...) of vectors (..., 3) along normals of any length."""
    return np.asarray(np.einsum("...i,...i->...", apart, normal) / np.linalg.norm(normal, axis=-1))
