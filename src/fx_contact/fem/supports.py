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

    Local, but for `ghosted`.  Without oblique planes N is 0 everywhere, and costs nothing.

    Args:
        prescribed: (n, 3) float64, prescribed displacements [m], NaN where free.
        oblique: (k,) int nodes on oblique planes, and N there, (k, 3, 3) float64; None where the scene has no such
            plane, which is the same on all ranks.

    Attributes:
        prescribed: as given.
        free: (n, 3) bool, components that are not prescribed.
        oblique: whether the scene has oblique planes.
    """

    def __init__(self, prescribed, oblique=None):
        self.prescribed, self.free = prescribed, np.isnan(prescribed)
        self.oblique, self._oblique = oblique is not None, oblique
        if self.oblique:
            nodes, normal = oblique
            self._normal = np.concatenate([normal, np.zeros((1, 3, 3))])  # 0 of other nodes, place -1
            self._place = np.full(len(prescribed), -1)
            self._place[nodes] = np.arange(len(nodes))

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
        result[some] -= np.einsum("nij,nj->ni", self._normal[place[some]], vectors[some])
        return result

    def free_part(self, vectors, at=slice(None)):
        """What is free of vectors (m, 3), 0 in held directions: (m, 3) float64; arguments as of `along_planes`."""
        return self.along_planes(np.where(self.free[at], vectors, 0.0), at)

    def admissible(self, u):
        """The displacement (n, 3) [m] nearest to u, node by node, that meets the conditions."""
        return self.along_planes(np.where(self.free, u, self.prescribed))

    def in_cells(self, matrices, nodes):
        """P_i K_ij P_j of the matrices of cells.

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
        along = np.eye(3) - self._normal[place[cells]]
        half = along[:, :, None] @ matrices[cells]
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
        nodes, normal = self._oblique
        if len(nodes):
            free, rank = self.free[nodes], np.rint(np.trace(normal, axis1=1, axis2=2))
            scale = np.where(free, diagonal[nodes], 0.0).sum(axis=1) / (free.sum(axis=1) - rank)
            blocks = scale[:, None, None] * normal, np.arange(len(nodes)), np.arange(len(nodes) + 1)
            first = mat.getOwnershipRange()[0] // 3
            add_blocks(mat, bsr_matrix(blocks), (first + nodes).astype(np.int32))
        mat.assemble()

    def projector(self):
        """The projector on what is free: (3 n, 3 n) scipy sparse."""
        free = diags(self.free.ravel().astype(float))
        if not self.oblique:
            return free
        (nodes, normal), size = self._oblique, len(self.free)
        start = np.searchsorted(nodes, np.arange(size + 1))
        return free - bsr_matrix((normal, nodes, start), shape=(3 * size, 3 * size))

    def ghosted(self, prolongation):
        """Those of owned conforming nodes and of the ghosts: Supports.  Collective on the prolongation's comm."""
        prescribed, normal = prolongation.ghosted(self.prescribed), None
        if self.oblique:
            normal = prolongation.ghosted(self._normal[self._place].reshape(-1, 9)).reshape(-1, 3, 3)
        return _of_all(prescribed, normal)

    def at(self, nodes):
        """Those of some nodes, in their order: Supports."""
        if not self.oblique:
            return Supports(self.prescribed[nodes])
        return _of_all(self.prescribed[nodes], self._normal[self._place[nodes]])


def _of_all(prescribed, normal):
    """Supports with N (n, 3, 3) of all nodes, or None."""
    if normal is None:
        return Supports(prescribed)
    nodes = np.flatnonzero(normal.any(axis=(1, 2)))
    return Supports(prescribed, (nodes, normal[nodes]))
