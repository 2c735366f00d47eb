"""Springs across the closed contact, B^T k B: as entries of a matrix, and as products beside it."""

import numpy as np
from mpi4py import MPI
from scipy.sparse import bsr_matrix

from fx_contact.linalg.matrix import add_blocks


class Springs:
    """B^T k B beside a matrix, of any sign.

    Collective on the prolongation's comm.

    Args:
        jump: Jump.
        stiffness: (n,) float64, k [N/m].
    """

    def __init__(self, jump, stiffness):
        self._jump, self._stiffness = jump, stiffness

    def add_product(self, u, y):
        """y := y + B^T k B u; u [m], y [N], contiguous: (owned, 3) float64.  Collective."""
        self._jump.matrix.add_transposed(self._stiffness * self._jump.matrix.times(u), y)

    def add_force(self, u, y):
        """y := y + B^T k (B u - D), without the rounding of k B u and k D; as in `add_product`.  Collective."""
        penetration = self._jump.matrix.times(u) - self._jump.gap
        self._jump.matrix.add_transposed(self._stiffness * penetration, y)


class PenaltyTerm:
    """B^T k B of the active rows.

    Args:
        jump: Jump.
        stiffness: (n,) float64, k of each row; None: k_N of the penalty [N/m].
    """

    def __init__(self, jump, stiffness=None):
        self._jump = jump
        self._stiffness = jump.rows.stiffness if stiffness is None else stiffness

    def reserve(self, matrix):
        """Make entries for the nodes that rows couple, with zeros.  Local.

        Args:
            matrix: PETSc Mat in blocks of 3.
        """
        self._add(matrix, np.ones(len(self._stiffness), dtype=bool), np.zeros_like(self._stiffness))

    def change(self, matrix, before, after):
        """Turn the term of one active set into that of another.

        Collective.

        Args:
            matrix: PETSc Mat that has the term of `before`.
            before, after: (n,) bool, active rows.
        """
        sign = after.astype(float) - before
        self._add(matrix, before != after, sign * self._stiffness)
        matrix.assemble()

    def _add(self, matrix, some, stiffness):
        """Add B^T k B of some rows, (n,) bool, zeros too."""
        blocks = self._jump.blocks
        which = some[blocks.row]
        if not which.any():
            return
        row, values = (np.cumsum(some) - 1)[blocks.row[which]], blocks.values[which][:, None]
        node, column = np.unique(blocks.node[which], return_inverse=True)
        indptr, shape = np.searchsorted(row, np.arange(some.sum() + 1)), (some.sum(), 3 * len(node))
        scaled = bsr_matrix((stiffness[some][row][:, None, None] * values, column, indptr), shape=shape)
        product = scaled.T @ bsr_matrix((values, column, indptr), shape=shape)
        number = self._jump.rows.prolongation.index_map.local_to_global(node.astype(np.int32))
        add_blocks(matrix, product, number.astype(np.int32))

    def difference(self, active, other, known):
        """What this term of one active set has more, or less, than another term of another set.

        Collective.

        Args:
            active, known: (n,) bool, active rows of this term and of the other one.
            other: PenaltyTerm.

        Returns:
            Springs; None where there is no difference.
        """
        stiffness = active * self._stiffness - known * other._stiffness
        some = self._jump.rows.prolongation.comm.allreduce(bool(stiffness.any()), op=MPI.LOR)
        return Springs(self._jump, stiffness) if some else None

    def right_hand_side(self, active, forces=0.0):
        """B^T (k D - f).

        Collective.

        Args:
            active: (n,) bool, the rows that have k.
            forces: (n,) float64, f that act whatever the penetration, or 0 [N].

        Returns:
            (owned, 3) float64 [N].
        """
        result = np.zeros((self._jump.rows.prolongation.owned, 3))
        self._jump.matrix.add_transposed(active * self._stiffness * self._jump.gap - forces, result)
        return result

    def force(self, u):
        """k (B u - D), the force of every row that the penalty alone would exert.

        Collective.

        Args:
            u: (owned, 3) float64 [m].

        Returns:
            (n,) float64, compression positive [N].
        """
        return self._stiffness * self._jump.penetration(u)
