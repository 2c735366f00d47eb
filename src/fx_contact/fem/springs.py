"""Elastic supports in the discrete problem: stiffness S of the springs of a scene on the curved leaf faces.

With a displacement u and the stiffness per area H of an elastic support, v^T S u is the integral of v . H u over its
surface.  P^T S P is part of the stiffness matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_matrix

from fx_contact.fem.cell_products import CellSum, cell_constraints, constrained
from fx_contact.fem.leaf_quadrature import faces_on, gauss_rule, integrands, shape_functions
from fx_contact.fem.prolongation import Prolongation
from fx_contact.geometry import hexahedron
from fx_contact.items.elastic_support import Elastic
from fx_contact.parallel.arrays import FloatArray, Int64Array, IntArray


@dataclass(frozen=True, eq=False)
class _Faces:
    """Faces of some leaves on an elastic support.

    Attributes:
        support: index of the support.
        leaves: (n,).
        local: (k,), nodes of the face among those of a leaf.
        functions: (g, k), at the Gauss points [-].
        points: (n, g, 3), the Gauss points [m].
        stiffness: (n, g, 3, 3), H times the weights [N/m].
    """

    support: int
    leaves: IntArray
    local: Int64Array
    functions: FloatArray
    points: FloatArray
    stiffness: FloatArray

    def displacement(self, u: FloatArray) -> FloatArray:
        """At the Gauss points, (n, g, 3) [m], by values (nleaves, (p+1)^3, 3) [m] at the nodes of all leaves."""
        return self.functions @ u[self.leaves[:, None], self.local]

    def forces(self, u: FloatArray) -> FloatArray:
        """-H u times the weights, (n, g, 3) [N], by values as of `displacement`."""
        return -np.einsum("ngij,ngj->ngi", self.stiffness, self.displacement(u))

    def matrices(self) -> FloatArray:
        """S of each face: (n, k, k, 3, 3) [N/m]."""
        n, g = self.stiffness.shape[:2]
        k = len(self.local)
        products = np.einsum("ga,gb->abg", self.functions, self.functions).reshape(k * k, g)
        return (products @ self.stiffness.reshape(n, g, 9)).reshape(n, k, k, 3, 3)


class Springs:
    """The springs of elastic supports on this rank's leaves.

    Local, except for `internal_forces`.

    Args:
        supports: of the scene.
        order: of the geometry of the leaves.
    """

    def __init__(self, supports: Sequence[Elastic], prolongation: Prolongation, order: int) -> None:
        self._supports, self._prolongation, self._order = supports, prolongation, order

    @cached_property
    def _faces(self) -> list[_Faces]:
        space, faces = self._prolongation.space, []
        forest, degree = space.forest, space.degree
        for index, support in enumerate(self._supports):

            def density(_: FloatArray, normals: FloatArray, support: Elastic = support) -> FloatArray:
                """H as nine components."""
                return support.stiffness(normals).reshape(-1, 9)

            for leaves, face in faces_on(forest, support.surface):
                rule, local = gauss_rule(degree, self._order, face), hexahedron.face_nodes(degree)[face]
                functions = shape_functions(degree, face, rule)[:, local]
                for some, x, h in integrands(forest, leaves, self._order, density, face, rule):
                    faces.append(_Faces(index, some, local, functions, x, h.reshape(*h.shape[:2], 3, 3)))
        return faces

    def on(self, prolongation: Prolongation) -> Springs:
        """Springs of the same supports on displacements of another degree, on the same forest.  Local."""
        return Springs(self._supports, prolongation, self._order)

    def internal_forces(self, u: FloatArray) -> FloatArray:
        """P^T S u, (owned, 3) [N], of values (nleaves, (p+1)^3, 3) [m].  Collective."""
        space = self._prolongation.space
        sums = np.zeros((len(space), 3))
        for part in self._faces:
            nodes = space.cells[part.leaves[:, None], part.local]
            np.add.at(sums, nodes, -part.functions.T @ part.forces(u))
        return self._prolongation.restrict(sums)

    def energy(self, u: FloatArray) -> float:
        """u^T S u of this rank [J], of values (nleaves, (p+1)^3, 3) [m]."""
        return -sum(float((part.displacement(u) * part.forces(u)).sum()) for part in self._faces)

    def totals(self, u: FloatArray) -> FloatArray:
        """Forces on the bodies and their moments about the origin by values (nleaves, (p+1)^3, 3) [m].

        Returns:
            (supports, nbodies, 6), of this rank's leaves, force [N] and moment [N m].
        """
        forest = self._prolongation.space.forest
        totals = np.zeros((len(self._supports), len(forest.mesh.bodies), 6))
        for part in self._faces:
            force = part.forces(u)
            moment = np.cross(part.points, force).sum(axis=1)
            body = forest.mesh.body[forest.cell[part.leaves]]
            np.add.at(totals[part.support], body, np.concatenate([force.sum(axis=1), moment], axis=1))
        return totals

    def matrix(self, place: IntArray, size: int) -> csr_matrix:
        """S of nodal values (size, 3), of which nodes of the space have places (m,): (3 size, 3 size).  Local."""
        each, result = np.arange(3), csr_matrix((3 * size, 3 * size))
        for part in self._faces:
            nodes = 3 * place[self._prolongation.space.cells[part.leaves[:, None], part.local]]
            values = part.matrices()
            row, column = nodes[:, :, None, None, None] + each[:, None], nodes[:, None, :, None, None] + each
            both = (np.broadcast_to(which, values.shape).ravel() for which in (row, column))
            result = result + csr_matrix((values.ravel(), tuple(both)), result.shape)
        return result

    def add_to(self, total: CellSum) -> None:
        """Add P^T S P."""
        for part in self._faces:
            cells = self._prolongation.space.cells[part.leaves[:, None], part.local]
            nodes, weights = cell_constraints(self._prolongation, cells)
            total.add(constrained(part.matrices(), weights), nodes)
