"""The constraint projector: B P = 0 for closed rows."""

from __future__ import annotations

from copy import copy

import numpy as np

from fx_contact.contact.constraint_rows import ConstraintRows
from fx_contact.contact.gram import Gram
from fx_contact.contact.jump import Jump, Products
from fx_contact.parallel.arrays import BoolArray, FloatArray
from fx_contact.parallel.mpi import any_true


class Projection:
    """P = I - W^-1 B^T (B W^-1 B^T)^-1 B, so that B P = 0 for the closed rows.

    W weighs each node by its modulus, and by `RowKind.FOLLOWED`: the softer body follows the stiffer one.  P^T K P is
    then as well conditioned as K.  With rates w of unknown motions t the rows satisfy B u = D - w^T t for some t, and
    their forces w f = 0: f = G^-1 v - Y (w Y)^-1 w G^-1 v with G = B W^-1 B^T (`gram`), Y = G^-1 w^T.

    Collective on the prolongation's comm.

    Args:
        rates: (k, n), w [-].

    Attributes:
        closed: (n,), the rows with B P = 0, by `of`.
        rigid: no closed row is a spring.

    Raises:
        SolveError: in `of` and in all products, as `Gram.solve`.
    """

    def __init__(self, jump: Jump, rates: FloatArray | None = None) -> None:
        rows, entries = jump.rows, jump.rows.entries
        self._rates = np.zeros((0, len(rows))) if rates is None else rates
        self._jump, self._comm = jump, jump.comm
        weighted = jump.values / _weights(rows)[:, None]
        self._weighted = Products(rows, weighted)
        diagonal = entries.sums((jump.values * weighted).sum(axis=1), len(rows))
        count = rows.prolongation.sums_at(entries.node, (jump.values != 0).astype(float))
        share = rows.area / rows.node_area if any_true(self._comm, count > 1) else None
        self._gram = Gram(jump.matrix, self._weighted, diagonal, share)

    def of(self, jump: Jump, active: BoolArray, stiffness: FloatArray | None = None) -> Projection:
        """The projection of active rows (n,), without those whose jump conditions prescribe, onto B u = D of a jump.

        Args:
            jump: with the same rows, and gaps of its own.
            stiffness: (n,), springs of the rows, inf of rigid ones [N/m]; None: all are rigid.
        """
        closed = active & jump.movable
        self._gram = self._gram.on(closed)
        other = copy(self)
        other._jump = jump
        other._close(closed, np.full(len(closed), np.inf) if stiffness is None else stiffness)
        return other

    def _close(self, closed: BoolArray, stiffness: FloatArray) -> None:
        self.closed = closed
        self._compliance = np.divide(1.0, stiffness, out=np.zeros(len(closed)), where=closed)
        self.rigid = not any_true(self._comm, self._compliance != 0)
        self._moved: tuple[FloatArray, FloatArray] | None = None  # Y^T, and (w Y)^-1
        if len(self._rates):
            rates = np.where(closed, self._rates, 0.0)
            moved = np.stack([self._gram.solve(rate) for rate in rates])
            self._moved = moved, np.linalg.pinv(self._comm.allreduce(rates @ moved.T), hermitian=True)

    def onto_closed(self, u: FloatArray) -> FloatArray:
        """The displacement (owned, 3) [m] nearest to u in the norm of W with B u = D, or least |B u - D|, if closed."""
        u = u.copy()
        self._weighted.add_transposed(self._forces(self._jump.gap - self._jump.matrix.times(u)), u)
        return u

    def apply(self, u: FloatArray) -> None:
        """u := P u, (owned, 3) [m], contiguous."""
        self._weighted.add_transposed(-self._forces(self._jump.matrix.times(u)), u)

    def apply_transpose(self, f: FloatArray) -> FloatArray:
        """f := P^T f, (owned, 3) [N], contiguous; returns the forces (n,) [N] of closed rows that balance the rest."""
        forces = self._forces(self._weighted.times(f))
        self._jump.matrix.add_transposed(-forces, f)
        return forces

    def add_yielding(self, forces: FloatArray, u: FloatArray) -> None:
        """u (owned, 3) [m] += the displacement with B u = f / k on closed rows with a penalty."""
        if not self.rigid:
            self._weighted.add_transposed(self._forces(self._compliance * forces), u)

    def _forces(self, values: FloatArray) -> FloatArray:
        """Forces (n,) [N] of closed rows whose displacement W^-1 B^T f has these jumps (n,) [m], but for motions."""
        forces = self._gram.solve(values)
        if self._moved is None:
            return forces
        moved, inverse = self._moved
        work = self._comm.allreduce(self._rates @ np.where(self.closed, forces, 0.0))
        return np.asarray(forces - work @ inverse @ moved)


def _weights(rows: ConstraintRows) -> FloatArray:
    """W at the entries (b,), the mean at each node: rows of bonded parts share nodes.  Collective."""
    entries, kinds = rows.entries, np.array([[1.0, kind.FOLLOWED] for kind in rows.kinds])
    weight = kinds[rows.contact[entries.row], entries.side] * rows.modulus[entries.row, entries.side]
    sums = rows.prolongation.sums_at(entries.node, np.column_stack([weight, np.ones_like(weight)]))
    total, count = rows.prolongation.ghosted(sums)[entries.node].T
    return np.asarray(total / count)
