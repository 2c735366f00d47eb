"""Displacement conditions at conforming nodes, as orthogonal projectors on the free displacements.

At a node some components are prescribed; on symmetry planes oblique to the axes also N u = 0, with N the projector on
the span of the normals there, without prescribed components.  With P the projector on what is left free and s similar
to the diagonal of K, the matrix is P K P + s (I - P).  Prescribed displacements u_D load the rest by -P K u_D.
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc
from scipy.sparse import bsr_matrix, diags, spmatrix

from fx_contact.fem.prolongation import Prolongation
from fx_contact.linalg.matrix import add_blocks
from fx_contact.parallel.arrays import FloatArray, IntArray


class Supports:
    """Displacement conditions at some nodes.

    Local, except for `ghosted` and `add_normal_part`.

    Args:
        prescribed: (n, 3), prescribed displacements [m], NaN where `free`.
        oblique: (k,) nodes on oblique planes, ascending, and P there, (k, 3, 3); None if the scene has no such plane,
            alike on all ranks.

    Attributes:
        oblique_nodes: (k,), nodes on oblique planes.
    """

    def __init__(self, prescribed: FloatArray, oblique: tuple[IntArray, FloatArray] | None = None) -> None:
        self.prescribed, self.free, self.oblique = prescribed, np.isnan(prescribed), oblique is not None
        self.oblique_nodes: IntArray = np.zeros(0, dtype=np.int64)
        if oblique is not None:
            self.oblique_nodes, tangential = oblique
            self._tangential = np.concatenate([tangential, np.eye(3)[None]])  # of other nodes, place -1
            self._place = np.full(len(prescribed), -1)
            self._place[self.oblique_nodes] = np.arange(len(self.oblique_nodes))

    @property
    def values(self) -> FloatArray:
        """(n, 3), prescribed displacements [m], 0 where free."""
        return np.nan_to_num(self.prescribed)

    def tangential(self, vectors: FloatArray, at: slice | IntArray = slice(None)) -> FloatArray:
        """P of vectors (m, 3) at nodes: without components normal to oblique planes; prescribed ones remain."""
        if not self.oblique:
            return vectors
        place, result = self._place[at], vectors.copy()
        some = place >= 0
        result[some] = np.einsum("nij,nj->ni", self._tangential[place[some]], vectors[some])
        return result

    def free_part(self, vectors: FloatArray, at: slice | IntArray = slice(None)) -> FloatArray:
        """Projection of vectors on the free displacements; arguments as in `tangential`."""
        return self.tangential(np.where(self.free[at], vectors, 0.0), at)

    def admissible(self, u: FloatArray) -> FloatArray:
        """Displacement (n, 3) [m] closest to u, node by node, that satisfies the conditions."""
        return self.tangential(np.where(self.free, u, self.prescribed))

    def eliminate(self, matrices: FloatArray, nodes: IntArray) -> tuple[IntArray, FloatArray]:
        """P_i^T K_ij P_j of cell matrices (n, k, k, 3, 3) at nodes (n, k), in place.

        The diagonal entries of K stay at prescribed components.

        Returns:
            cells (m,) with displacements u_D that are prescribed and not 0, and K u_D there, (m, k, 3) [N].
        """
        if self.oblique:
            place = self._place[nodes]
            cells = np.flatnonzero((place >= 0).any(axis=1))
            tangential = self._tangential[place[cells]]
            half = tangential.swapaxes(2, 3)[:, :, None] @ matrices[cells]
            matrices[cells] = half @ tangential[:, None]
        held, values = ~self.free[nodes], np.nan_to_num(self.prescribed[nodes])
        moved, cells = (np.flatnonzero(some.any(axis=(1, 2))) for some in (values, held))
        forces = np.einsum("nabij,nbj->nai", matrices[moved], values[moved], optimize=True)
        free, some = (~held[cells]).astype(float), matrices[cells]
        diagonal = np.einsum("naaii->nai", some)
        kept = (1 - free) * diagonal
        some *= free[:, :, None, :, None]
        some *= free[:, None, :, None]
        diagonal += kept  # a view
        matrices[cells] = some
        return moved, forces

    def add_normal_part(self, mat: PETSc.Mat, diagonal: FloatArray) -> None:
        """Add s N to the diagonal blocks of P K P, assembled, s the mean tangential entry of its diagonal (n, 3) [N/m].

        Collective on mat.comm, if there are oblique planes.
        """
        if not self.oblique:
            return
        nodes, normal = self.oblique_nodes, np.eye(3) - self._tangential[:-1]
        if len(nodes):
            free, rank = self.free[nodes], np.trace(normal, axis1=1, axis2=2)
            scale = np.where(free, diagonal[nodes], 0.0).sum(axis=1) / (free.sum(axis=1) - rank)
            blocks = scale[:, None, None] * normal, np.arange(len(nodes)), np.arange(len(nodes) + 1)
            first = mat.getOwnershipRange()[0] // 3
            add_blocks(mat, bsr_matrix(blocks), (first + nodes).astype(np.int32))
        mat.assemble()

    def in_frames(self) -> Supports:
        """Supports in orthonormal frames R aligned with the planes, with P R in the place of P.

        R is the smallest rotation that turns the nearest axis into the normal, or into the line in which planes meet.
        Normal directions become prescribed components with value 0, which suits multigrid.
        """
        if not self.oblique:
            return self
        tangential, prescribed = self._tangential[:-1], self.prescribed.copy()
        line = np.trace(tangential, axis1=1, axis2=2) < 1.5
        outer = np.where(line[:, None, None], tangential, np.eye(3) - tangential)
        axis, each = np.einsum("nii->ni", outer).argmax(axis=1), np.arange(len(outer))
        unit = np.eye(3)[axis]
        to = outer[each, axis] / np.sqrt(outer[each, axis, axis])[:, None]
        both = unit + to
        rotation = np.eye(3) + 2 * to[:, :, None] * unit[:, None]
        rotation -= both[:, :, None] * both[:, None] / (1 + to[each, axis])[:, None, None]
        normal = (np.arange(3) == axis[:, None]) != line[:, None]
        prescribed[self.oblique_nodes] = np.where(normal, 0.0, prescribed[self.oblique_nodes])
        return Supports(prescribed, (self.oblique_nodes, np.where(normal[:, None], 0.0, tangential @ rotation)))

    def projector(self) -> spmatrix:
        """Projector (3 n, 3 n) on the free displacements."""
        free = diags(self.free.ravel().astype(float))
        if not self.oblique:
            return free
        every, size = np.arange(len(self.free) + 1), 3 * len(self.free)
        return bsr_matrix((self._tangential[self._place], every[:-1], every), shape=(size, size)) @ free

    def ghosted(self, prolongation: Prolongation) -> Supports:
        """Supports of owned conforming nodes and of the ghosts.  Collective on prolongation.comm."""
        prescribed, tangential = prolongation.ghosted(self.prescribed), None
        if self.oblique:
            tangential = prolongation.ghosted(self._tangential[self._place].reshape(-1, 9)).reshape(-1, 3, 3)
        return _of_all(prescribed, tangential)

    def at(self, nodes: IntArray) -> Supports:
        """Supports of some nodes, in their order."""
        return _of_all(self.prescribed[nodes], self._tangential[self._place[nodes]] if self.oblique else None)


def _of_all(prescribed: FloatArray, tangential: FloatArray | None) -> Supports:
    """Supports with P (n, 3, 3) of all nodes, or None."""
    if tangential is None:
        return Supports(prescribed)
    nodes = np.flatnonzero((tangential != np.eye(3)).any(axis=(1, 2)))
    return Supports(prescribed, (nodes, tangential[nodes]))
