"""Surfaces meshed apart for tests: leaf facets with hanging nodes, their tables, and the matrices of multipliers."""

from functools import cached_property

import numpy as np
from conftest import WORLD
from model_problems import grown
from scipy.sparse import coo_matrix
from scipy.spatial import cKDTree

from fx_contact.contact.dual_functions import DualFunctions, SegmentIntegrals
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.forest.forest import Forest
from fx_contact.geometry.leaf_facets import LeafFacets
from fx_contact.geometry.root_facets import face_functions
from fx_contact.geometry.shapes import join, root_mesh_from_shapes
from fx_contact.geometry.solids import block
from fx_contact.surfaces.contact_surfaces import ContactSurfaces
from fx_contact.surfaces.facet_pairing import Pairing


def forest_of(mesh):
    """The unrefined forest of a root mesh without contact."""
    return Forest.of_roots(WORLD, mesh, Pairing(mesh, ()), ContactSurfaces(mesh, ()))


def hollow_ball(cells, inner, outer, order):
    """A hollow ball of six blocks with the sides "bottom" (inside) and "top"."""

    def sixth(x):
        u, v = (np.tan((x[axis] - 0.5) * np.pi / 2) for axis in (0, 1))
        radius = (inner + (outer - inner) * x[2]) / np.sqrt(1 + u * u + v * v)
        return radius * u, radius * v, radius

    part = block((0, 0, 0), (1, 1, 1), (cells, cells, 1), order).placed(sixth)
    return join(
        *(part.turned("y", angle) for angle in (0, 90, 180, 270)), part.turned("x", 90), part.turned("x", -90)
    )


class Side:
    """One surface of a forest: leaf facets, conforming nodes and tables of hanging nodes."""

    def __init__(self, forest, name, degree):
        self.forest, self.degree = forest, degree
        leaf, face = forest.boundary_faces(forest.mesh.surfaces[name])
        self.facets = LeafFacets.of_leaves(
            forest.mesh, forest.cell[leaf], forest.level[leaf], forest.anchor[leaf], face
        )
        self.space = Space(forest, degree)
        self.prolongation = Prolongation(self.space)
        self.leaf_nodes = self.space.on_faces(leaf, face)
        self.hanging = self.prolongation.hanging[self.leaf_nodes]
        self._tables()

    @classmethod
    def of(cls, shape, degree, side, levels=0, random=0, salt=7):
        """A side of a shape, refined everywhere, then at random."""
        forest = forest_of(root_mesh_from_shapes({"body": shape}))
        for _ in range(levels):
            forest, _ = forest.refined(np.ones(len(forest), dtype=bool))
        return cls(grown(forest, random, share=0.3, salt=salt), f"body {side}", degree)

    def __len__(self):
        return len(self.facets)

    def _tables(self):
        """`nodes`: conforming node at each place of a facet; a hanging one's is of a master outside of the facet."""
        count, matrix = self.leaf_nodes.shape[1], self.prolongation.matrix
        self.nodes = self.prolongation.conforming[self.leaf_nodes].astype(int)
        self.tables = np.zeros((len(self.leaf_nodes), count, count))
        for facet, nodes in enumerate(self.leaf_nodes):
            rows = matrix[nodes]
            columns = np.unique(rows.indices[rows.data != 0])
            outside = np.setdiff1d(columns, self.nodes[facet])
            assert len(outside) == self.hanging[facet].sum()
            self.nodes[facet, self.hanging[facet]] = outside
            self.tables[facet] = rows[:, self.nodes[facet]].toarray()

    @cached_property
    def count(self):
        """Number of conforming nodes of the body."""
        return self.prolongation.matrix.shape[1]

    @cached_property
    def positions(self):
        """(count, 3), of the conforming nodes."""
        result = np.zeros((self.count, 3))
        own = ~self.prolongation.hanging
        result[self.prolongation.conforming[own]] = self.space.positions()[own]
        return result

    def sums(self, values):
        """Sums over facets of values (n, (p+1)^2, ...) at conforming nodes."""
        result = np.zeros((self.count, *values.shape[2:]))
        np.add.at(result, self.nodes, values)
        return result

    @cached_property
    def loads(self):
        """int N~ over the whole surface, by Gauss's rule: (count,)."""
        points, weights = (values / 2 for values in np.polynomial.legendre.leggauss(8))
        uv = np.stack(np.meshgrid(points + 0.5, points + 0.5), axis=-1).reshape(-1, 2)
        jacobian = self.facets.at(np.broadcast_to(uv, (len(self), *uv.shape))).jacobian
        nodal = (jacobian * np.kron(weights, weights)) @ face_functions(self.degree, uv)
        return self.sums(np.einsum("eij,ei->ej", self.tables, nodal))


def near(first, second, factor=1.1):
    """Pairs (k, 2) of leaf facets whose spheres meet."""
    centres = [side.facets.corners.mean(axis=1) for side in (first, second)]
    radii = [
        np.linalg.norm(side.facets.corners - c[:, None], axis=2).max() for side, c in zip((first, second), centres)
    ]
    found = cKDTree(centres[0]).query_ball_tree(cKDTree(centres[1]), factor * sum(radii))
    return np.array([(i, j) for i, row in enumerate(found) for j in row], dtype=np.int64).reshape(-1, 2)


class Mortar:
    """Multipliers on the first of two sides, with matrices `D` and `M` between conforming nodes."""

    def __init__(self, first, second, pairs=None, depth=np.inf, direction=None, held=()):
        self.first, self.second = first, second
        self.pairs = near(first, second) if pairs is None else pairs
        self.segments = SegmentIntegrals.of(first.facets, second.facets, self.pairs, first.degree, depth, direction)
        self.dual = DualFunctions(first.facets, first.degree, first.tables, self.segments)
        cover, whole = first.sums(self.dual.cover), first.sums(self.dual.whole)
        part = np.divide(cover, whole, out=np.zeros_like(cover), where=whole > 0)
        self.kept_nodes = first.sums(self.dual.candidates(part[first.nodes]).astype(float)) > 0
        self.kept_nodes[list(held)] = False
        self.kept = self.kept_nodes[first.nodes]
        self.functions = self.dual.functions(self.kept)
        self.integrals = self.dual.integrals(self.kept)
        self.area = first.sums(self.integrals.area)

    def _matrix(self, rows, columns, values, count):
        places = [np.broadcast_to(a, values.shape).ravel() for a in (rows[:, :, None], columns[:, None, :])]
        return coo_matrix((values.ravel(), places), shape=(self.first.count, count)).tocsr()

    @cached_property
    def D(self):
        return self._matrix(self.first.nodes, self.first.nodes, self.integrals.first, self.first.count)

    @cached_property
    def M(self):
        one, two = self.pairs.T
        conforming = self.integrals.second @ self.second.tables[two]
        return self._matrix(self.first.nodes[one], self.second.nodes[two], conforming, self.second.count)
