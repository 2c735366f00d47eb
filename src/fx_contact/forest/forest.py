"""Distributed leaves of a forest of octrees: refine, balance, move; the vertices, edges and faces they have.

A leaf is (root cell, level, integer anchor).  The root mesh is replicated, the leaves are distributed; no array of
the length of all leaves exists on a rank.  Forests are immutable: refining and moving return new ones.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fx_contact.forest.glue import Glue
from fx_contact.forest.homes import Homes
from fx_contact.parallel.errors import GeometryError
from fx_contact.parallel.exchange import Exchange, few
from fx_contact.parallel.memory import check_leaves
from fx_contact.parallel.mpi import Directory
from fx_contact.problem import hexahedron, lattice
from fx_contact.problem.contact_surfaces import ContactSurfaces
from fx_contact.problem.facet_pairing import Pairing
from fx_contact.problem.lattice import MAX_LEVEL, SIDE, Lattice
from fx_contact.problem.root_mesh import RootMesh


@dataclass(frozen=True, eq=False)
class Forest:
    """This rank's leaves of a balanced forest.

    Attributes:
        comm: MPI communicator.
        mesh: RootMesh.
        lattice: Lattice of that mesh.
        pairing: Pairing of that mesh.
        contact_surfaces: ContactSurfaces of that mesh.
        cell: (n,) int32, root cell of each leaf.
        level: (n,) int8, 0 for a root cell.
        anchor: (n, 3) int32, low corner in lattice units of the root cell.
        cuts: (ranks - 1,) int64, where the last partition along the space-filling curve has cut it, ascending; None
            before the first. It decides where facts about keys are brought together, and nothing else.
    """

    comm: MPI.Comm
    mesh: RootMesh
    lattice: Lattice
    pairing: Pairing
    contact_surfaces: ContactSurfaces
    cell: np.ndarray
    level: np.ndarray
    anchor: np.ndarray
    cuts: np.ndarray | None = None

    @classmethod
    def of_roots(
        cls, comm: MPI.Comm, mesh: RootMesh, pairing: Pairing, contact_surfaces: ContactSurfaces
    ) -> "Forest":
        """The unrefined forest, root cells dealt out in equal blocks by their number.

        Local.
        """
        first, last = (len(mesh.cells) * (comm.rank + i) // comm.size for i in (0, 1))
        cell = np.arange(first, last, dtype=np.int32)
        level, anchor = np.zeros(len(cell), np.int8), np.zeros((len(cell), 3), np.int32)
        return cls(comm, mesh, Lattice(mesh), pairing, contact_surfaces, cell, level, anchor)

    def __len__(self):
        return len(self.cell)

    @cached_property
    def size_global(self):
        """Number of leaves on all ranks.  Collective on comm at first use."""
        return self.comm.allreduce(len(self))

    @cached_property
    def corners(self):
        """(n, 8, 3) int32, lattice coordinates of the leaf corners."""
        return lattice.leaf_corners(self.anchor, self.level)

    def evaluate(self, cell, points):
        """Where points of the lattice are, on the curved geometry.

        Local.

        Args:
            cell: (n,) int, root cells.
            points: (n, ..., 3) int32, lattice coordinates in those cells; float64 between lattice points.

        Returns:
            (n, ..., 3) float64 [m].
        """
        cells = np.repeat(cell, math.prod(points.shape[1:-1]))
        return self.mesh.evaluate(cells, points.reshape(-1, 3, 1) / SIDE).reshape(points.shape)

    def positions(self, leaf, corner):
        """Where corners of leaves are, on the curved geometry.

        Local.

        Args:
            leaf, corner: (m,) int.

        Returns:
            (m, 3) float64 [m].
        """
        return self.evaluate(self.cell[leaf], self.corners[leaf, corner])

    @cached_property
    def centres(self):
        """(n, 3) float64, middles of the leaves on the curved geometry [m]."""
        return self.evaluate(self.cell, self.corners.mean(axis=1))

    @cached_property
    def representatives(self):
        """(n,) int64, code of the leaf that stands for each group of facing leaves.  Local."""
        return self.pairing.representatives(self.cell, self.level, self.anchor)

    @cached_property
    def homes(self):
        """Where facts about keys are brought together (`Homes`): near the leaves, on few ranks by a hash.  Local."""
        return Homes(self, None if few(self.comm) else self.cuts, self.comm.size)

    @cached_property
    def vertices(self):
        """The distinct corners of the leaves (`LatticePoints`).  Collective on comm at first use."""
        return LatticePoints(self, self.corners)

    @cached_property
    def edges(self):
        """The distinct edges of the leaves, by their midpoints (`LatticePoints`).  Collective on comm at first use."""
        return LatticePoints(self, lattice.edge_midpoints(self.corners))

    @cached_property
    def faces(self):
        """The distinct faces of the leaves, by their centres (`LatticePoints`).  Collective on comm at first use."""
        return LatticePoints(self, lattice.face_centres(self.corners))

    def contact_faces(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Faces of this rank's leaves that lie on contact surfaces.

        Local.

        Returns:
            (m,) leaf indices, (m,) local faces.
        """
        return self.contact_surfaces.faces(self.cell, self.level, self.anchor)

    def paired_faces(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Those of them that have a partner.

        Local.

        Returns:
            (m,) leaf indices, (m,) local faces.
        """
        return self.pairing.faces(self.cell, self.level, self.anchor)

    def stands_on(self, pairing: Pairing, contact_surfaces: ContactSurfaces) -> bool:
        """Whether its contact surfaces and partners are these; both are of one root mesh.  Local."""
        return self.contact_surfaces.same(contact_surfaces) and np.array_equal(self.pairing.partner, pairing.partner)

    def boundary_faces(self, facets):
        """Faces of this rank's leaves that lie on given root facets.

        Local.

        Args:
            facets: (k, 2) int rows (root cell, local face).

        Returns:
            (m,) int64 leaf indices, (m,) int64 local faces.
        """
        return self._within(facets, lattice.root_faces(self.anchor, self.level))

    def boundary_edges(self, edges):
        """Edges of this rank's leaves that lie on given root edges.

        Local.

        Args:
            edges: (k, 2) int rows (root cell, local edge).

        Returns:
            (m,) int64 leaf indices, (m,) int64 local edges.
        """
        return self._within(edges, lattice.root_edges(self.anchor, self.level))

    def _within(self, rows, on):
        """Faces or edges of leaves that lie on those of root cells (k, 2), of all that lie on any (n, 6 or 12) bool."""
        wanted = np.zeros((len(self.mesh.cells), on.shape[1]), dtype=bool)
        wanted[rows[:, 0], rows[:, 1]] = True
        return np.nonzero(on & wanted[self.cell])

    def refined(self, marked):
        """Refine marked leaves, their partners, and as many more as the balance of the forest demands.

        Collective on comm.  The rules: facing leaves are refined together (5); a leaf must not have a quarter point on
        one of its edges, so that every edge has at most one hanging node; leaves around the rim of a paired surface
        are refined with it, so that facing vertices hang together or not at all.

        Args:
            marked: (n,) bool.

        Returns:
            The new Forest, children in the place of their parent, and the `Glue` between the two.

        Raises:
            GeometryError: a leaf of the finest level is marked.
            SolveError: the new forest would not fit into the memory that the hosts have left.
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
        return replace(self, cell=self.cell[parent], level=level, anchor=anchor), Glue(parent, child)

    def refined_with(self, times, values=None):
        """Refine leaves, some of them repeatedly, and carry a field along.

        Collective on comm.  Once refined, leaves stop at the finest level.

        Args:
            times: (n,) int, how often to refine each leaf; its children all alike.
            values: (n, (p+1)^3, ...) float64, a field of degree p at the nodes of the leaves; None: there is none.

        Returns:
            The new Forest, and the field at the nodes of its leaves, or None.

        Raises:
            GeometryError: a leaf of the finest level is to be refined.
            SolveError: as `refined`.
        """
        forest, glue = self.refined(times > 0)
        values = None if values is None else glue.carry(values)
        times = np.maximum(times[glue.parent] - 1, 0)
        times[forest.level == MAX_LEVEL] = 0
        if not self.comm.allreduce(bool(times.any()), op=MPI.LOR):
            return forest, values
        return forest.refined_with(times, values)

    def moved(self, destination):
        """Send leaves to other ranks.

        Collective on comm.

        Args:
            destination: (n,) int rank of each leaf.

        Returns:
            The new Forest, leaves ordered by source rank, and the Exchange that carries other leaf data likewise.
        """
        exchange = Exchange(self.comm, destination)
        leaves = {name: exchange.forward(getattr(self, name)) for name in ("cell", "level", "anchor")}
        return replace(self, **leaves), exchange

    def ordered(self, order):
        """The same forest with this rank's leaves in another order.  Local.

        Args:
            order: (n,) int permutation.
        """
        return replace(self, cell=self.cell[order], level=self.level[order], anchor=self.anchor[order])

    def _closure(self, marked):
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
            fresh = new & ~marked
            if not self.comm.allreduce(bool(fresh.any()), op=MPI.LOR):
                return marked
            marked |= fresh

    def _forbidden_edges(self, marked):
        """Keys of edges that no unrefined leaf may have once the marked leaves are refined."""
        leaves = np.flatnonzero(marked & (self.level > 0))
        child = (self.anchor[leaves] // lattice.leaf_side(self.level[leaves])[:, None]) & 1
        corner = child @ [1, 2, 4]
        # A child's corner one step from the corner it shares with its parent is the midpoint of a parent's edge.
        middles = self.vertices.cells[leaves[:, None], corner[:, None] ^ [1, 2, 4]]
        rim = self._rim_edges(marked)
        return np.concatenate([self.vertices.keys[middles.ravel()], self.edges.directory.keys[rim]])

    def _rim_edges(self, marked):
        """Edges of marked leaves on the rim of paired surfaces: (m,) positions in `edges`."""
        marked = np.flatnonzero(marked)
        on = lattice.root_edges(self.anchor[marked], self.level[marked]) & self.pairing.rim[self.cell[marked]]
        leaf, edge = np.nonzero(on)
        return self.edges.cells[marked[leaf], edge]


class LatticePoints:
    """Distinct lattice points of this rank's leaves, in the order in which the leaves touch them first.

    Collective on comm.

    Args:
        forest: Forest.
        points: (n, k, 3) int32, lattice coordinates of k points of each leaf.

    Attributes:
        keys: (m,) int64 keys.
        cells: (n, k) int32, position of each leaf's points in `keys`.
        directory: Directory of the keys.
        example: (m, 2) int64, a leaf and the number there of each point.
    """

    def __init__(self, forest, points):
        k = points.shape[1]
        keys, index, cells = np.unique(
            forest.lattice.keys(forest.cell, points), return_index=True, return_inverse=True
        )
        order = np.argsort(index, kind="stable")
        self._ascending = np.argsort(order)
        self.keys = keys[order]
        self.cells = self._ascending[cells].reshape(-1, k).astype(np.int32)
        self.example = np.stack(np.divmod(index[order], k), axis=1)
        self.directory = Directory(forest.comm, self.keys, forest.homes.of_points)

    def __len__(self):
        return len(self.keys)

    def find(self, keys):
        """Positions of keys among this rank's points, -1 where they are not.  Local.

        Args:
            keys: (...) int64.

        Returns:
            (...) int64.
        """
        if not len(self):
            return np.full(np.shape(keys), -1, dtype=np.int64)
        slot = np.searchsorted(self.keys, keys, sorter=self._ascending)
        place = self._ascending[np.minimum(slot, len(self) - 1)]
        return np.where(self.keys[place] == keys, place, -1)
