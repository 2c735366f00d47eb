"""Dual multipliers of degree p on leaf facets of the first surface, and their integrals over what faces the second.

On a facet N are its (p+1)^2 functions, N~ = C^T N the conforming ones by its table C of hanging nodes, and the
multipliers psi are combinations of N.  All integrals are those over the part of the facet that the second surface
covers, by one rule (`segments`).

On facets that are covered, psi = diag(d) M^-1 N~ with d = int N~ and M = int N~ N~^T: biorthogonal, int psi_j N~_k is
d_j if j = k and else 0 (Wohlmuth, SIAM J. Numer. Anal. 38, 2000; on the covered part: Cichosz, Bischoff, CMAME 200,
2011).  On facets that the rim of the second surface crosses d may be negative and M singular: psi are the bilinear hats
of the corners there, which are not negative.  Multipliers of nodes that are not kept go to the nearest kept ones of the
same facet.

Guaranteed, to rounding, for any cover, slivers and hanging nodes included, as long as a facet has a kept node:

- the psi of a facet add up to 1, so that a constant pressure makes the forces int N~ on the first surface and int N2 on
  the second, and both balance;
- integrals of psi are positive where the nodes kept are those of `candidates`, or some of them;
- psi of covered facets of which all nodes are kept are biorthogonal.

Not guaranteed: rows that differ where the second surface is a strip between two rims inside of one facet.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_matrix

from fx_contact.contact.segments import create_segments
from fx_contact.geometry.leaf_facets import LeafFacets
from fx_contact.geometry.root_facets import face_functions
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int64Array

#: Part of the integral of each function that must be left on a facet which counts as covered.  A strip of 0.90 of a
#: facet has it for the corners at degree 2, one of 0.71 at degree 1.
_COVERED = 0.5
#: Nodes of which less than this part is covered, relative to the most covered one of a facet, have no multiplier: their
#: rows differ too little.  Largest condition of the Gram matrix B B^T with rows of length 1, in `test_dual_functions`,
#: at degree 1 and 2 (with every facet covered: 6 and 17):
#:
#:     part                       0.05         0.1        0.15       0.2        0.3
#:     rims across a row         741, 298    288, 298   288, 230   222, 211    29, 211
#:     only a strip             9979, 562   2146, 180   836, 143   468, 124    10, 68
#:     rims at any angle         793, 429    340, 338   283, 337   283, 337    26, 337
#:
#: A facet of which a strip of 0.62 is covered beside covered ones has multipliers at its outer side too.
_KEPT = 0.2
#: Uncovered part of a facet up to which it is rounding, and that of the rules' on curved facets.
_ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class SegmentIntegrals:
    """Integrals over the segments of pairs of facets of the (p+1)^2 functions N of facets, ordered as their nodes.

    Attributes:
        pairs: (k, 2), numbers of the first and the second facet.
        coupling: (k, (p+1)^2, (p+1)^2), int N N2 of each pair [m^2].
        mass: (n, (p+1)^2, (p+1)^2), int N N of each first facet [m^2].
        moments: (n, (p+1)^2, 13), int N times 1 [m^2], the vector to the second surface [m^3], the unit normals of both
            surfaces out of their bodies [m^2], and the position [m^3].
    """

    pairs: Int64Array
    coupling: FloatArray
    mass: FloatArray
    moments: FloatArray

    @classmethod
    def of(
        cls,
        first: LeafFacets,
        second: LeafFacets,
        pairs: Int64Array,
        degree: int,
        depth: float = np.inf,
        direction: FloatArray | None = None,
    ) -> "SegmentIntegrals":
        """Integrals on first facets (n,) over second ones (m,) by pairs (k, 2); as `create_segments`.  Local."""
        nodes = (degree + 1) ** 2
        coupling = np.zeros((len(pairs), nodes * nodes))
        mass, moments = np.zeros((len(first), nodes * nodes)), np.zeros((len(first), nodes * 13))
        for part in create_segments(first[pairs[:, 0]], second[pairs[:, 1]], degree, depth, direction):
            one, two = face_functions(degree, part.first), face_functions(degree, part.second)
            ones = np.ones((len(one), 1))
            data = np.hstack([ones, part.apart, part.first_normal, part.second_normal, part.position])
            weighted = part.weight[:, None] * one
            facets, facet = np.unique(pairs[part.pair, 0], return_inverse=True)
            mass[facets] += _sums(facet, len(facets), weighted, one)
            moments[facets] += _sums(facet, len(facets), weighted, data)
            some, pair = np.unique(part.pair, return_inverse=True)
            coupling[some] = _sums(pair, len(some), weighted, two)
        shape = (-1, nodes, nodes)
        return cls(pairs, coupling.reshape(shape), mass.reshape(shape), moments.reshape(-1, nodes, 13))


@dataclass(frozen=True, eq=False)
class MultiplierIntegrals:
    """Integrals of the multipliers psi on the first facets, ordered as their nodes.

    Attributes:
        pairs: (k, 2), numbers of the first and the second facet.
        second: (k, (p+1)^2, (p+1)^2), int psi N2 of each pair, with the functions of the second leaf facet [m^2].
        first: (n, (p+1)^2, (p+1)^2), int psi N~ of each first facet [m^2].
        area: (n, (p+1)^2), int psi [m^2].
        apart: (n, (p+1)^2, 3), int psi times the vector from the first surface to the second [m^3].
        first_normal, second_normal: (n, (p+1)^2, 3), int psi times the unit normals out of the bodies [m^2].
        position: (n, (p+1)^2, 3), int psi x [m^3].
    """

    pairs: Int64Array
    second: FloatArray
    first: FloatArray
    area: FloatArray
    apart: FloatArray
    first_normal: FloatArray
    second_normal: FloatArray
    position: FloatArray


class DualFunctions:
    """The multipliers on first facets (n,).

    In the order of use: sums of `cover` and `whole` over the facets of each conforming node give the parts of the nodes
    that are covered; a node is kept if it is one of the `candidates` on any facet; `integrals` has the rest.

    Args:
        facets: the first facets.
        degree: of the displacements, 1 or 2.
        tables: (n, (p+1)^2, (p+1)^2), C: values at the nodes of a facet from those of its conforming nodes.
        segments: integrals on these facets.
    """

    def __init__(self, facets: LeafFacets, degree: int, tables: FloatArray, segments: SegmentIntegrals) -> None:
        self._degree, self._tables, self._segments = degree, tables, segments
        points, weights = (np.asarray(values) / 2 for values in np.polynomial.legendre.leggauss(degree + 2))
        uv = np.stack(np.meshgrid(points + 0.5, points + 0.5), axis=-1).reshape(-1, 2)
        jacobian = facets.at(np.broadcast_to(uv, (len(facets), *uv.shape))).jacobian
        functions = face_functions(degree, uv)
        whole = (jacobian * np.kron(weights, weights)) @ functions
        conforming = tables.swapaxes(1, 2)
        self._mass = conforming @ segments.mass @ tables
        self._covered = segments.moments[:, :, 0]
        with np.errstate(invalid="ignore"):
            part = _apply(conforming, self._covered) / _apply(conforming, whole)
        #: (n,), facets that count as covered, and those that a rim crosses.
        self.covered: BoolArray = part.min(axis=1) >= _COVERED
        self.crossed: BoolArray = self._covered.sum(axis=1) < (1 - _ROUNDING) * whole.sum(axis=1)
        #: (n, (p+1)^2), integrals of the hats over the covered part of the facets and over all [m^2]; 0 without hat.
        self.cover, self.whole = (_apply(self._hats, values) for values in (self._covered, whole))

    @cached_property
    def _hats(self) -> FloatArray:
        """Hats (n, (p+1)^2, (p+1)^2) of the corners of facets by N: the conforming functions at degree 1."""
        if self._degree == 1:  # a corner that hangs has none of its own
            return self._tables.swapaxes(1, 2)
        v, u = np.divmod(np.arange(9), 3)
        hats = np.zeros((9, 9))  # at degree 2 corners never hang: they are nodes of the coarser side too
        hats[[0, 2, 6, 8]] = face_functions(1, np.stack([u, v], axis=1) / 2).T
        return np.broadcast_to(hats, self._tables.shape)

    def candidates(self, part: FloatArray) -> BoolArray:
        """Nodes (n, (p+1)^2) that are kept for the sake of each facet, by the covered part of each, cover over whole.

        All nodes of covered facets, and on others those at least a fifth as covered as the most covered one.
        """
        mine = self.cover > 0
        most = np.where(mine, part, 0.0).max(axis=1, keepdims=True)
        return self.covered[:, None] | (mine & (part >= _KEPT * most))

    def functions(self, kept: BoolArray) -> FloatArray:
        """psi by N: (n, (p+1)^2, (p+1)^2), rows of zero for nodes that are not kept (n, (p+1)^2)."""
        result = self._hats.copy()
        some = self.covered
        mass, tables = self._mass[some], self._tables[some].swapaxes(1, 2)
        integral = _apply(tables, self._covered[some])
        result[some] = integral[:, :, None] * np.linalg.solve(mass, tables)
        return _moved(self._degree, kept) @ result

    def means(self, kept: BoolArray) -> tuple[FloatArray, FloatArray]:
        """int W_j psi_k (n, (p+1)^2, (p+1)^2) and int W_j (n, (p+1)^2) with the W of `rim_pressure` [m^2]."""
        ends = np.array([[1, 0, 0], [1, 0, 1], [0, 0, 1]]) if self._degree == 2 else np.eye(2)
        hats = np.kron(ends, ends) @ self._hats
        moments = hats @ self._segments.mass @ self.functions(kept).swapaxes(1, 2)
        return moments, _apply(hats, self._covered)

    def integrals(self, kept: BoolArray) -> MultiplierIntegrals:
        """Integrals of psi, 0 for nodes that are not kept (n, (p+1)^2)."""
        functions, segments = self.functions(kept), self._segments
        moments = functions @ segments.moments
        return MultiplierIntegrals(
            segments.pairs,
            functions[segments.pairs[:, 0]] @ segments.coupling,
            functions @ segments.mass @ self._tables,
            moments[:, :, 0],
            *(moments[:, :, start : start + 3] for start in (1, 4, 7, 10)),
        )


def _moved(degree: int, kept: BoolArray) -> FloatArray:
    """Shares (n, i, j) of nodes i in the multiplier of each node j: its own, or of the nearest that are kept."""
    v, u = np.divmod(np.arange((degree + 1) ** 2), degree + 1)
    distance = (u[:, None] - u) ** 2 + (v[:, None] - v) ** 2
    from_kept = np.where(kept[:, :, None], distance, np.inf)
    nearest = kept[:, :, None] & (from_kept == from_kept.min(axis=1, keepdims=True))
    return np.asarray(nearest / np.maximum(nearest.sum(axis=1, keepdims=True), 1))


def _sums(group: Int64Array, count: int, one: FloatArray, two: FloatArray) -> FloatArray:
    """Sums over points (m,) of each group of products of functions (m, i) and (m, j): (count, i j)."""
    products = (one[:, :, None] * two[:, None, :]).reshape(len(one), one.shape[1] * two.shape[1])
    indicator = csr_matrix((np.ones(len(group)), (group, np.arange(len(group)))), shape=(count, len(group)))
    return np.asarray(indicator @ products)


def _apply(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    return np.asarray((matrices @ vectors[:, :, None])[:, :, 0])
