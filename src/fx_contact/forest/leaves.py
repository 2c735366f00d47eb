"""Leaves of a rank in the root cells of a forest: positions, distinct lattice points, faces on surfaces."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fx_contact.forest.homes import Homes
from fx_contact.forest.lattice_points import LatticePoints
from fx_contact.geometry import lattice
from fx_contact.geometry.lattice import SIDE, Lattice
from fx_contact.geometry.leaf_facets import LeafFacets
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int8Array, Int32Array, Int64Array, IntArray
from fx_contact.parallel.exchange import few
from fx_contact.surfaces.contact_surfaces import ContactSurfaces
from fx_contact.surfaces.facet_pairing import Pairing


@dataclass(frozen=True, eq=False)
class Leaves:
    """This rank's leaves of a forest.

    Attributes:
        mesh: root mesh, the same on all ranks, as are `lattice`, `pairing` and `contact_surfaces`.
        cell: (n,), root cell of each leaf.
        level: (n,), 0 for a root cell.
        anchor: (n, 3), low corner in lattice units of the root cell.
        cuts: (ranks - 1,), ascending keys at which the last partition cut the space-filling curve; None before the
            first.  They determine the home ranks of keys only.
    """

    comm: MPI.Intracomm
    mesh: RootMesh
    lattice: Lattice
    pairing: Pairing
    contact_surfaces: ContactSurfaces
    cell: Int32Array
    level: Int8Array
    anchor: Int32Array
    cuts: Int64Array | None = None

    def __len__(self) -> int:
        return len(self.cell)

    @cached_property
    def size_global(self) -> int:
        """Number of leaves on all ranks.  Collective on comm at first use."""
        return self.comm.allreduce(len(self))

    @cached_property
    def corners(self) -> Int32Array:
        """(n, 8, 3), lattice coordinates of the leaf corners."""
        return lattice.leaf_corners(self.anchor, self.level)

    def evaluate(self, cell: IntArray, points: npt.NDArray[np.number[Any]]) -> FloatArray:
        """Positions (n, ..., 3) [m] of points (n, ..., 3), in lattice coordinates of root cells (n,).  Local."""
        cells = np.repeat(cell, math.prod(points.shape[1:-1]))
        places = np.asarray(points, np.float64).reshape(-1, 3, 1) / SIDE
        return self.mesh.evaluate(cells, places).reshape(points.shape)

    @cached_property
    def centres(self) -> FloatArray:
        """(n, 3), positions of the leaf centres [m]."""
        return self.evaluate(self.cell, self.corners.mean(axis=1))

    @cached_property
    def representatives(self) -> Int64Array:
        """(n,), lowest leaf code of the group of facing leaves to which each leaf belongs.  Local."""
        return self.pairing.representatives(self.cell, self.level, self.anchor)

    @cached_property
    def homes(self) -> Homes:
        """Home ranks of lattice points and leaves: near the leaves, by a hash on few ranks.  Local."""
        return Homes(self.mesh, self.lattice, self.pairing, None if few(self.comm) else self.cuts, self.comm.size)

    def lattice_points(self, points: Int32Array) -> LatticePoints:
        """The distinct ones of k points (n, k, 3) of each leaf, in lattice coordinates.  Collective on comm."""
        return LatticePoints(self.comm, self.lattice.keys(self.cell, points), self.homes)

    @cached_property
    def vertices(self) -> LatticePoints:
        """The distinct corners of the leaves.  Collective on comm at first use."""
        return self.lattice_points(self.corners)

    @cached_property
    def edges(self) -> LatticePoints:
        """The distinct edges of the leaves, by their midpoints.  Collective on comm at first use."""
        return self.lattice_points(lattice.edge_midpoints(self.corners))

    @cached_property
    def faces(self) -> LatticePoints:
        """The distinct faces of the leaves, by their centres.  Collective on comm at first use."""
        return self.lattice_points(lattice.face_centres(self.corners))

    def contact_faces(self) -> tuple[Int64Array, Int64Array]:
        """Leaves (m,) and their local faces (m,) on contact surfaces.  Local."""
        return lattice.faces_in(self.contact_surfaces.every, self.cell, self.level, self.anchor)

    def paired_faces(self) -> tuple[Int64Array, Int64Array]:
        """Leaves (m,) and their local faces (m,) that have a partner.  Local."""
        return lattice.faces_in(self.pairing.paired, self.cell, self.level, self.anchor)

    def facets(self, leaf: Int64Array, face: Int64Array) -> LeafFacets:
        """Local faces (m,) of leaves (m,).  Local."""
        return LeafFacets.of_leaves(self.mesh, self.cell[leaf], self.level[leaf], self.anchor[leaf], face)

    def stands_on(self, pairing: Pairing, contact_surfaces: ContactSurfaces) -> bool:
        """True if the contact surfaces and partners of the forest are these, of the same root mesh.  Local."""
        return self.contact_surfaces.same(contact_surfaces) and np.array_equal(self.pairing.partner, pairing.partner)

    def boundary_faces(self, facets: IntArray) -> tuple[Int64Array, Int64Array]:
        """Leaves (m,) and their local faces (m,) on root facets (k, 2).  Local."""
        return self._within(facets, lattice.root_faces(self.anchor, self.level))

    def boundary_edges(self, edges: IntArray) -> tuple[Int64Array, Int64Array]:
        """Leaves (m,) and their local edges (m,) on root edges (k, 2).  Local."""
        return self._within(edges, lattice.root_edges(self.anchor, self.level))

    def _within(self, rows: IntArray, on: BoolArray) -> tuple[Int64Array, Int64Array]:
        """Faces or edges of leaves on those of root cells (k, 2), from the mask (n, 6 or 12) of those on any."""
        wanted = np.zeros((len(self.mesh.cells), on.shape[1]), dtype=bool)
        wanted[tuple(rows.T)] = True
        leaf, entity = np.nonzero(on & wanted[self.cell])
        return leaf, entity
