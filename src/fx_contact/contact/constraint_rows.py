"""The constraint operator B: sparse rows, each with a gap D, an area and a stiffness.  Contact is B u <= D.

A row belongs to a vertex of the first contact surface, as a nodal multiplier does, and may have entries at any number
of vertices of both.  Whatever solves with contact asks for rows alone; node pairs (`node_pairs`) are one kind of them.
"""

from abc import ABC, abstractmethod
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from dolfinx.la import InsertMode, vector
from mpi4py import MPI
from scipy.sparse import csr_matrix

from fx_contact.contact.enforcement import HELD, STIFF


@dataclass(frozen=True, eq=False)
class Blocks:
    """The entries of rows as blocks of 1 x 3, row by row.

    Attributes:
        row: (b,) int64, local number of the row, ascending.
        vertex: (b,) int64, position in the prolongation's index map.
        side: (b,) int64, 0 where the vertex is on the first surface, 1 on the second.
        values: (b, 3) float64 [-].
    """

    row: np.ndarray
    vertex: np.ndarray
    side: np.ndarray
    values: np.ndarray

    def sums(self, values, count):
        """Sums of (b,) float64 values over the blocks of each of `count` rows: (count,) float64.  Local."""
        return np.bincount(self.row, values, count).astype(float)


@dataclass(frozen=True, eq=False)
class ConstraintRows(ABC):
    """The rows of B that this rank holds, each row on one rank.

    Attributes:
        prolongation: Prolongation, on whose conforming unknowns B acts.
        first: (n,) int64, the vertex of each row on the first surface, position in the prolongation's index map.
        normal: (n, 3) float64, unit direction from the first body to the second, the mean of both surfaces' normals.
        gap: (n,) float64, D, initial distance along the normal on the true curved geometry [m].
        area: (n,) float64, tributary area [m^2].
        stiffness: (n,) float64, k_N, or that of the springs in the matrix of exact contact [N/m].
        modulus: (n, 2) float64, E/(1 - nu^2) of the first and the second body [Pa].
        position: (n, 3) float64, undeformed position on the first surface [m].
        bodies: (n, 2) int32, first and second body, positions in the root mesh's `bodies`.
        contact: (n,) int32, the contact pair of the scene that each row belongs to.
        symmetry: int, copies of the modelled part that make the whole.
    """

    prolongation: object
    first: np.ndarray
    normal: np.ndarray
    gap: np.ndarray
    area: np.ndarray
    stiffness: np.ndarray
    modulus: np.ndarray
    position: np.ndarray
    bodies: np.ndarray
    contact: np.ndarray
    symmetry: int

    def __len__(self):
        return len(self.first)

    @property
    @abstractmethod
    def blocks(self):
        """Blocks of B: u = t on the first surface and 0 on the second gives B u = n . t.  Local."""

    @property
    def key(self):
        """(n,) int64, number of each row, another for all rows of all ranks.  Local."""
        vertex = self.prolongation.index_map.local_to_global(self.first.astype(np.int32))
        return vertex << 32 | self.contact

    @property
    def relative_stiffness(self):
        """(n,) float64, c of k_N = c E* A^(1/2), A the row's area, 1/E* the sum of 1/modulus [-].  Local."""
        return self.stiffness * (1 / self.modulus).sum(axis=1) / np.sqrt(self.area)

    @property
    def bounded_stiffness(self):
        """(n,) float64, k_N in the matrix: that of the factor `HELD` where it is stiffer than `STIFF` [N/m].  Local."""
        relative = self.relative_stiffness
        return self.stiffness * np.where(relative > STIFF, HELD / relative, 1.0)

    def couplings(self):
        """Which conforming vertices a row couples: (owned + ghosts, owned + ghosts) scipy CSR bool.  Local."""
        imap, blocks = self.prolongation.index_map, self.blocks
        shape = len(self), imap.size_local + imap.num_ghosts
        touched = csr_matrix((np.ones(len(blocks.row), dtype=bool), (blocks.row, blocks.vertex)), shape=shape)
        return touched.T @ touched

    def jump(self, u):
        """B u, how far the bodies move towards each other.

        Collective.  What all vertices of a row move alike is taken off first: B of a translation is rounding.

        Args:
            u: (owned, 3) float64, conforming displacement [m].

        Returns:
            (n,) float64 [m].
        """
        u, blocks, n = self.prolongation.ghosted(u), self.blocks, len(self)
        common = u[self.first]
        relative = np.einsum("bi,bi->b", blocks.values, u[blocks.vertex] - common[blocks.row])
        of_common = np.stack([blocks.sums(column, n) for column in blocks.values.T], axis=1)
        return blocks.sums(relative, n) + np.einsum("ni,ni->n", of_common, common)

    def penetration(self, u):
        """B u - D, positive where the bodies overlap.  Collective; as `jump`."""
        return self.jump(u) - self.gap

    def transposed(self, force):
        """B^T f.

        Collective.

        Args:
            force: (n,) float64 [N].

        Returns:
            (owned, 3) float64, what opposes it at the conforming vertices [N].
        """
        imap, blocks = self.prolongation.index_map, self.blocks
        sums = np.zeros((imap.size_local + imap.num_ghosts, 3))
        np.add.at(sums, blocks.vertex, force[blocks.row][:, None] * blocks.values)
        return self.prolongation.summed(sums)

    def pressing(self, force, group, count):
        """Force of groups of rows, and about the approach of the bodies that it takes.

        Collective.

        Args:
            force: (n,) float64, compression positive [N].
            group: (n,) int, the group of each row that presses, as `contact`.
            count: number of groups on all ranks.

        Returns:
            two (count,) float64: F of the modelled part [N], and F / (E* A^(1/2)) of the whole, A the area under
            pressure, as of a punch on a half-space [m].
        """
        presses = force > 0
        columns = force, self.area, self.area * (1 / self.modulus).sum(axis=1)
        sums = np.stack([np.bincount(group[presses], column[presses], count) for column in columns]).astype(float)
        self.prolongation.comm.Allreduce(MPI.IN_PLACE, sums)
        total, area, compliance = sums
        approach = np.divide(total * compliance, area**1.5, out=np.zeros(count), where=area > 0)
        return total, np.sqrt(self.symmetry) * approach

    def at_first(self, values):
        """Sums over all rows of the same first vertex, of whichever contact pair and rank.

        Collective.

        Args:
            values: (n, k) float64.

        Returns:
            (n, k) float64.
        """
        imap = self.prolongation.index_map
        sums = np.zeros((imap.size_local + imap.num_ghosts, values.shape[1]))
        np.add.at(sums, self.first, values)
        return self.prolongation.ghosted(self.prolongation.summed(sums))[self.first]


class Products:
    """Products with a matrix of rows and with its transpose.

    Collective on the prolongation's comm.  They touch the unknowns of the rows alone, and need no message where every
    rank owns those of its rows.

    Args:
        rows: ConstraintRows.
        blocks: Blocks, as theirs but for the values.
    """

    def __init__(self, rows, blocks):
        self._prolongation = rows.prolongation
        vertex, place = np.unique(blocks.vertex, return_inverse=True)
        self._dofs = (3 * vertex[:, None] + np.arange(3)).ravel()
        columns, indptr = 3 * place[:, None] + np.arange(3), 3 * np.searchsorted(blocks.row, np.arange(len(rows) + 1))
        entries = blocks.values.ravel(), columns.ravel(), indptr
        self._matrix = csr_matrix(entries, shape=(len(rows), len(self._dofs)))
        self._transposed = self._matrix.T.tocsr()
        away = bool((vertex >= self._prolongation.owned).any())
        self._local = not self._prolongation.comm.allreduce(away, op=MPI.LOR)

    def times(self, u):
        """The product with a displacement.

        Collective.

        Args:
            u: (owned, 3) float64.

        Returns:
            (n,) float64.
        """
        u = u if self._local else self._prolongation.ghosted(u)
        return self._matrix @ u.reshape(-1)[self._dofs]

    def add_transposed(self, values, y):
        """Add the product of the transpose with values of the rows to y.

        Collective.

        Args:
            values: (n,) float64.
            y: (owned, 3) float64, contiguous; changed in place.
        """
        if self._local:
            y.reshape(-1)[self._dofs] += self._transposed @ values
            return
        result = vector(self._prolongation.index_map, 3)
        result.array[self._dofs] = self._transposed @ values
        result.scatter_reverse(InsertMode.add)
        y += result.array[: y.size].reshape(-1, 3)


class Jump:
    """B on the components that no condition prescribes, and D less what the prescribed ones contribute.

    Collective on the prolongation's comm.

    Args:
        rows: ConstraintRows.
        prescribed: (owned, 3) float64, prescribed displacements [m], NaN where free.

    Attributes:
        rows: as given.
        blocks: Blocks of B, 0 at prescribed components.
        matrix: Products with these.
        gap: (n,) float64 [m].
        movable: (n,) bool, where conditions leave the jump free.
    """

    #: Entries up to this one are the rounding of unit normals along an axis.
    _ROUNDING = 1e-8

    def __init__(self, rows, prescribed):
        self.rows, blocks = rows, rows.blocks
        free = np.isnan(rows.prolongation.ghosted(prescribed))[blocks.vertex]
        values = np.where(free & (np.abs(blocks.values) > self._ROUNDING), blocks.values, 0.0)
        self.blocks = replace(blocks, values=values)
        self.matrix = Products(rows, self.blocks)
        self.movable = blocks.sums(values.any(axis=1), len(rows)) > 0
        self.gap = rows.gap - rows.jump(np.nan_to_num(prescribed))

    def with_gap(self, gap):
        """The same for another D: Jump.  Local.

        Args:
            gap: (n,) float64, less what prescribed components contribute [m].
        """
        other = copy(self)
        other.gap = gap
        return other


def resultants(scene, rows, force):
    """What forces of rows add to the force of their contact pair: along its direction, else all of them.

    Local.

    Args:
        scene: Scene.
        rows: ConstraintRows.
        force: (n,) float64, along the normals [N].

    Returns:
        (n,) float64 [N].
    """
    result = force.copy()
    for index, direction in enumerate(pair.unit_direction for pair in scene.contact):
        if direction is not None:
            ours = rows.contact == index
            result[ours] *= rows.normal[ours] @ direction
    return result


def loose_bodies(scene, rows, active):
    """Bodies that neither the displacement conditions nor the active rows hold.

    Collective.

    Args:
        scene: Scene.
        rows: ConstraintRows.
        active: (n,) bool.

    Returns:
        list of str, names of the bodies; the same on all ranks.
    """
    if not len(scene.free_motions):
        return []
    first, second = (scene.motion(rows.position[active], rows.bodies[active, i], rows.normal[active]) for i in (0, 1))
    resistance = (first - second).T @ (first - second)
    rows.prolongation.comm.Allreduce(MPI.IN_PLACE, resistance)
    return scene.unresisted(resistance)
