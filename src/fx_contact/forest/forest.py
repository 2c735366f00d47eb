"""Distributed leaves of a forest of octrees: refinement, 2:1 balance, migration.

A leaf is (root cell, level, integer anchor).  The root mesh is replicated, the leaves are distributed.  Forests are
immutable: refinement and migration return new ones.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from mpi4py import MPI

from fx_contact.forest.facing_facets import FacingFacets
from fx_contact.forest.leaves import Leaves
from fx_contact.geometry import hexahedron, lattice
from fx_contact.geometry.lattice import MAX_LEVEL, Lattice
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int8Array, Int64Array, IntArray
from fx_contact.parallel.errors import GeometryError
from fx_contact.parallel.exchange import Exchange
from fx_contact.parallel.memory import check_leaves
from fx_contact.parallel.mpi import Directory
from fx_contact.surfaces.contact_surfaces import ContactSurfaces
from fx_contact.surfaces.facet_pairing import Pairing


@dataclass(frozen=True, eq=False)
class RefinementMap:
    """Parent and child of each leaf of a refined forest; a leaf and its parent are on the same rank.

    Attributes:
        parent: (n,), index of the leaf before refinement.
        child: (n,), number of the leaf among the children of its parent, -1 where the parent was not refined.
    """

    parent: Int64Array
    child: Int8Array

    def interpolated(self, values: FloatArray) -> FloatArray:
        """Nodal values (n, (p+1)^3, ...) of a field of degree p, from those before refinement.  Local; exact."""
        result: FloatArray = values[self.parent]
        for child, interpolation in enumerate(hexahedron.child_interpolation(hexahedron.order_of(values.shape[1]))):
            rows = self.child == child
            result[rows] = np.einsum("ij,nj...->ni...", interpolation, result[rows])
        return result


@dataclass(frozen=True, eq=False)
class Forest(Leaves):
    """This rank's leaves of a balanced forest, with the attributes of `Leaves`."""

    @classmethod
    def of_roots(
        cls, comm: MPI.Intracomm, mesh: RootMesh, pairing: Pairing, contact_surfaces: ContactSurfaces
    ) -> "Forest":
        """The unrefined forest, with equal blocks of root cells on all ranks.  Local."""
        first, last = (len(mesh.cells) * (comm.rank + i) // comm.size for i in (0, 1))
        cell = np.arange(first, last, dtype=np.int32)
        level, anchor = np.zeros(len(cell), np.int8), np.zeros((len(cell), 3), np.int32)
        return cls(comm, mesh, Lattice(mesh), pairing, contact_surfaces, cell, level, anchor)

    @cached_property
    def facing(self) -> dict[int, FacingFacets]:
        """Leaf facets across surfaces whose meshes do not match, by contact.  Collective on comm at first use."""
        surfaces = self.contact_surfaces.nonmatching
        return {index: FacingFacets(self, pair) for index, pair in surfaces.items()}

    def too_large(self, marked: BoolArray) -> BoolArray:
        """Leaves (n,) whose contact facets are too large for those they face once marked ones (n,) are refined.

        Collective on comm.  On surfaces whose meshes do not match (`FacingFacets`).
        """
        return np.logical_or.reduce([np.zeros_like(marked), *(one.too_large(marked) for one in self.facing.values())])

    def refined(self, marked: BoolArray) -> tuple["Forest", RefinementMap]:
        """Refine the marked leaves (n,), their partners, and the leaves that the balance requires; also the map.

        Collective on comm.  Facing leaves are refined together (5), and those around the rim of a paired surface with
        it; those of surfaces that do not match follow the sizes of the facets that they face (`too_large`).  No quarter
        point of an edge of a leaf is a vertex, so every edge has at most one hanging node.  Children are in the place
        of their parent.

        Raises:
            GeometryError: a leaf of the finest level is marked.
            SolveError: a host lacks memory for the new forest.
        """
        marked = self._closure(marked)
        deepest = self.comm.allreduce(int(self.level[marked].max(initial=-1)), op=MPI.MAX)
        if deepest >= MAX_LEVEL:
            raise GeometryError(
                f"leaves of the finest level, {MAX_LEVEL}, are marked: refine the root mesh, or round the sharp edge"
            )
        check_leaves(self.comm, len(self) + 7 * int(marked.sum()))
        parent = np.repeat(np.arange(len(self)), np.where(marked, 8, 1))
        child = np.full(len(parent), -1, dtype=np.int8)
        child[marked[parent]] = np.tile(np.arange(8, dtype=np.int8), int(marked.sum()))
        level = self.level[parent] + (child >= 0).astype(np.int8)
        offset = np.where(child[:, None] >= 0, hexahedron.CORNERS[child], 0).astype(np.int32)
        anchor = self.anchor[parent] + lattice.leaf_side(level)[:, None] * offset
        return replace(self, cell=self.cell[parent], level=level, anchor=anchor), RefinementMap(parent, child)

    def refined_with(self, times: IntArray, values: FloatArray | None = None) -> tuple["Forest", FloatArray | None]:
        """Refine each leaf a number of times (n,), and interpolate nodal values (n, (p+1)^3, ...) of a field.

        Collective on comm.  Children stop at the finest level.  Raises errors as `refined`.
        """
        forest, children = self.refined(times > 0)
        values = None if values is None else children.interpolated(values)
        times = np.maximum(times[children.parent] - 1, 0)
        times[forest.level == MAX_LEVEL] = 0
        if not self.comm.allreduce(bool(times.any()), op=MPI.LOR):
            return forest, values
        return forest.refined_with(times, values)

    def moved(self, destination: IntArray) -> tuple["Forest", Exchange]:
        """Send leaves to ranks (n,): the new forest, ordered by source rank, and the exchange, for other leaf data.

        Collective on comm.
        """
        exchange = Exchange(self.comm, destination)
        cell, level = exchange.forward(self.cell), exchange.forward(self.level)
        return replace(self, cell=cell, level=level, anchor=exchange.forward(self.anchor)), exchange

    def ordered(self, order: IntArray) -> "Forest":
        """Forest with this rank's leaves permuted by `order` (n,).  Local."""
        return replace(self, cell=self.cell[order], level=self.level[order], anchor=self.anchor[order])

    def _closure(self, marked: BoolArray) -> BoolArray:
        """Marked leaves and all that must be refined with them."""
        marked = np.array(marked, dtype=bool)
        paired = np.unique(self.paired_faces()[0])
        groups, group = np.unique(self.representatives[paired], return_inverse=True)
        facing = Directory(self.comm, groups, self.homes.of_leaves)
        fresh = marked.copy()
        while True:
            new = np.zeros_like(marked)
            new[paired] = facing.asked(groups[group[fresh[paired]]])[group]
            asked = self.edges.directory.asked(self._forbidden_edges(fresh))
            new |= asked[self.edges.cells].any(axis=1)
            new |= self.too_large(marked)
            fresh = new & ~marked
            if not self.comm.allreduce(bool(fresh.any()), op=MPI.LOR):
                return marked
            marked |= fresh

    def _forbidden_edges(self, marked: BoolArray) -> Int64Array:
        """Keys of edges that no unrefined leaf may have once the marked leaves are refined."""
        leaves = np.flatnonzero(marked & (self.level > 0))
        child = (self.anchor[leaves] // lattice.leaf_side(self.level[leaves])[:, None]) & 1
        corner = child @ [1, 2, 4]
        # A child's corner one step from the corner it shares with its parent is the midpoint of a parent's edge.
        middles = self.vertices.cells[leaves[:, None], corner[:, None] ^ [1, 2, 4]]
        on_rim = lattice.root_edges(self.anchor[marked], self.level[marked]) & self.pairing.rim[self.cell[marked]]
        rim = self.edges.cells[marked][on_rim]
        return np.concatenate([self.vertices.keys[middles.ravel()], self.edges.directory.keys[rim]])
