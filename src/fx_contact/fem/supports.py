"""What displacement conditions leave free at conforming nodes, by an orthogonal projector at each of them.

At a node some components are prescribed, and on planes of symmetry that are oblique to the axes also N u = 0: N is the
projector on the normals there, without prescribed components.  Components stay those along x, y and z.  With the
projector P = I - N and s like the diagonal of K, the matrix is P K P + s N.
"""

import numpy as np
from scipy.sparse import bsr_matrix, diags

from fx_contact.linalg.matrix import add_blocks


class Supports:
    """The displacement conditions at some nodes.

    Local, but for `ghosted` and `add_normal_part`.  Without oblique planes P is the identity, and costs nothing.

    Args:
        prescribed: (n, 3) float64, prescribed displacements [m], NaN where free.
        oblique: (k,) int nodes on oblique planes, ascending, and P there, (k, 3, 3) float64; None where the scene has
            no such plane, which is the same on all ranks.

    Attributes:
        prescribed: as given.
        free: (n, 3) bool, components that are not prescribed.
        oblique: whether the scene has oblique planes.
    """

    def __init__(self, prescribed, oblique=None):
        self.prescribed, self.free, self.oblique = prescribed, np.isnan(prescribed), oblique is not None
        if self.oblique:
            self._nodes, along = oblique
            self._along = np.concatenate([along, np.eye(3)[None]])  # of other nodes, place -1
            self._place = np.full(len(prescribed), -1)
            self._place[self._nodes] = np.arange(len(self._nodes))

    @property
    def values(self):
        """(n, 3) float64, prescribed displacements [m], 0 where free."""
        return np.nan_to_num(self.prescribed)

    def along_planes(self, vectors, at=slice(None)):
        """P of vectors: without what is across oblique planes; prescribed components stay.

        Args:
            vectors: (m, 3) float64.
            at: nodes of these; all by default.

        Returns:
            (m, 3) float64; the vectors themselves where there is no oblique plane.
        """
        if not self.oblique:
            return vectors
        place, result = self._place[at], vectors.copy()
        some = place >= 0
        result[some] = np.einsum("nij,nj->ni", self._along[place[some]], vectors[some])
        return result

    def free_part(self, vectors, at=slice(None)):
        """What is free of vectors (m, 3), 0 in held directions: (m, 3) float64; arguments as of `along_planes`."""
        return self.along_planes(np.where(self.free[at], vectors, 0.0), at)

    def admissible(self, u):
        """The displacement (n, 3) [m] nearest to u, node by node, that meets the conditions."""
        return self.along_planes(np.where(self.free, u, self.prescribed))

    def in_cells(self, matrices, nodes):
        """P_i^T K_ij P_j of the matrices of cells.

        Args:
            matrices: (n, k, k, 3, 3) float64; changed in place.
            nodes: (n, k) int, of the rows and columns.

        Returns:
            matrices.
        """
        if not self.oblique:
            return matrices
        place = self._place[nodes]
        cells = np.flatnonzero((place >= 0).any(axis=1))
        along = self._along[place[cells]]
        half = along.swapaxes(2, 3)[:, :, None] @ matrices[cells]
        matrices[cells] = half @ along[:, None]
        return matrices

    def add_normal_part(self, mat, diagonal):
        """Add s N to the diagonal blocks of a matrix, s the mean of K along the planes at the node.

        Collective on mat.comm, where there are oblique planes.

        Args:
            mat: PETSc Mat in blocks of 3, P K P, assembled.
            diagonal: (n, 3) float64, its diagonal [N/m].
        """
        if not self.oblique:
            return
        nodes, normal = self._nodes, np.eye(3) - self._along[:-1]
        if len(nodes):
            free, rank = self.free[nodes], np.trace(normal, axis1=1, axis2=2)
            scale = np.where(free, diagonal[nodes], 0.0).sum(axis=1) / (free.sum(axis=1) - rank)
            blocks = scale[:, None, None] * normal, np.arange(len(nodes)), np.arange(len(nodes) + 1)
            first = mat.getOwnershipRange()[0] // 3
            add_blocks(mat, bsr_matrix(blocks), (first + nodes).astype(np.int32))
        mat.assemble()

    def in_frames(self):
        """The same in orthonormal frames R along the planes: Supports with P R in the place of P.

        R takes the nearest axis to the normal, or to the line on which planes meet, by the smallest rotation.  Held
        directions are then components, prescribed as 0.  Multigrid that takes components by themselves likes frames
        better than projectors (`fem.coarse_level`).
        """
        if not self.oblique:
            return self
        along, prescribed = self._along[:-1], self.prescribed.copy()
        line = np.trace(along, axis1=1, axis2=2) < 1.5
        outer = np.where(line[:, None, None], along, np.eye(3) - along)
        axis, each = np.einsum("nii->ni", outer).argmax(axis=1), np.arange(len(outer))
        unit = np.eye(3)[axis]
        to = outer[each, axis] / np.sqrt(outer[each, axis, axis])[:, None]
        both = unit + to
        rotation = np.eye(3) + 2 * to[:, :, None] * unit[:, None]
        rotation -= both[:, :, None] * both[:, None] / (1 + to[each, axis])[:, None, None]
        held = (np.arange(3) == axis[:, None]) != line[:, None]
        prescribed[self._nodes] = np.where(held, 0.0, prescribed[self._nodes])
        return Supports(prescribed, (self._nodes, np.where(held[:, None], 0.0, along @ rotation)))

    def projector(self):
        """P on what is free: (3 n, 3 n) scipy sparse."""
        free = diags(self.free.ravel().astype(float))
        if not self.oblique:
            return free
        every, size = np.arange(len(self.free) + 1), 3 * len(self.free)
        return bsr_matrix((self._along[self._place], every[:-1], every), shape=(size, size)) @ free

    def ghosted(self, prolongation):
        """Those of owned conforming nodes and of the ghosts: Supports.  Collective on the prolongation's comm."""
        prescribed, along = prolongation.ghosted(self.prescribed), None
        if self.oblique:
            along = prolongation.ghosted(self._along[self._place].reshape(-1, 9)).reshape(-1, 3, 3)
        return _of_all(prescribed, along)

    def at(self, nodes):
        """Those of some nodes, in their order: Supports."""
        return _of_all(self.prescribed[nodes], self._along[self._place[nodes]] if self.oblique else None)


def _of_all(prescribed, along):
    """Supports with P (n, 3, 3) of all nodes, or None."""
    if along is None:
        return Supports(prescribed)
    nodes = np.flatnonzero((along != np.eye(3)).any(axis=(1, 2)))
    return Supports(prescribed, (nodes, along[nodes]))
