"""The constraint projector: B P = 0 for closed rows."""

from __future__ import annotations

from copy import copy

import numpy as np
from mpi4py import MPI

from fx_contact.contact.constraint_rows import ConstraintRows
from fx_contact.contact.jump import Jump, Products
from fx_contact.parallel.arrays import BoolArray, FloatArray
from fx_contact.parallel.errors import SolveError
from fx_contact.parallel.mpi import any_true


class Projection:
    """P = I - W^-1 B^T (B W^-1 B^T)^-1 B, so that B P = 0 for the closed rows.

    W weighs each node by its modulus, and by `RowKind.FOLLOWED`: the softer body follows the stiffer one.  P^T K P is
    then as well conditioned as K.  The Gram matrix B W^-1 B^T is diagonal if no component of a node is in two rows.
    Equal rows share their force by area.

    With rates w of unknown motions t the rows satisfy B u = D - w^T t for some t, and their forces w f = 0:
    f = G^-1 v - Y (w Y)^-1 w G^-1 v with G the Gram matrix, Y = G^-1 w^T.

    Collective on the prolongation's comm.

    Args:
        rates: (k, n), w [-].

    Attributes:
        closed: (n,), the rows with B P = 0, by `of`.
        rigid: no closed row is a spring.

    Raises:
        SolveError: in `of` and in all products, if the Gram system is not solved in `_ITERATIONS` iterations.
    """

    #: Most iterations and relative residual of the Gram system.  Node pairs take as many iterations as a node has
    #: pairs, rows of surfaces meshed apart 2 to 30 (`test_mortar_rows`, `test_crosspoints`).
    _ITERATIONS, _RESIDUAL = 200, 1e-15
    #: Rayleigh quotients of that system, relative to its diagonal, up to which they are the rounding of 0.
    _SINGULAR = 1e-14

    def __init__(self, jump: Jump, rates: FloatArray | None = None) -> None:
        rows, entries = jump.rows, jump.rows.entries
        self._rates = np.zeros((0, len(rows))) if rates is None else rates
        self._jump, self._comm = jump, jump.comm
        weighted = jump.values / _weights(rows)[:, None]
        self._weighted = Products(rows, weighted)
        self._diagonal = entries.sums((jump.values * weighted).sum(axis=1), len(rows))
        count = rows.prolongation.zeros(3)
        np.add.at(count, entries.node, (jump.values != 0).astype(float))
        most = float(rows.prolongation.summed(count).max(initial=0.0))
        self._shared = self._comm.allreduce(most, op=MPI.MAX) > 1
        self._share: FloatArray | float = rows.area / rows.node_area if self._shared else 1.0

    def of(self, jump: Jump, active: BoolArray, stiffness: FloatArray | None = None) -> Projection:
        """The projection of active rows (n,), without those whose jump conditions prescribe, onto B u = D of a jump.

        Args:
            jump: with the same rows, and gaps of its own.
            stiffness: (n,), springs of the rows, inf of rigid ones [N/m]; None: all are rigid.
        """
        other = copy(self)
        other._jump = jump
        other._close(active, np.full(len(active), np.inf) if stiffness is None else stiffness)
        return other

    def _close(self, active: BoolArray, stiffness: FloatArray) -> None:
        self.closed = closed = active & self._jump.movable
        self._inverse = np.divide(1.0, self._diagonal, out=np.zeros(len(closed)), where=closed)
        self._scale = self._inverse * self._share
        self._compliance = np.divide(1.0, stiffness, out=np.zeros(len(closed)), where=closed)
        self.rigid = not any_true(self._comm, self._compliance != 0)
        self._moved: tuple[FloatArray, FloatArray] | None = None  # Y^T, and (w Y)^-1
        if len(self._rates):
            rates = np.where(closed, self._rates, 0.0)
            moved = np.stack([self._solve_gram(rate) for rate in rates])
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
        forces = self._solve_gram(values)
        if self._moved is None:
            return forces
        moved, inverse = self._moved
        return np.asarray(
            forces - self._comm.allreduce(self._rates @ np.where(self.closed, forces, 0.0)) @ inverse @ moved
        )

    def _solve_gram(self, values: FloatArray) -> FloatArray:
        """(B W^-1 B^T)^-1 values on the closed rows, by conjugate residuals if not diagonal.  Raises SolveError."""
        if not self._shared:
            return self._inverse * values
        solution, residual = np.zeros(len(values)), np.where(self.closed, values, 0.0)
        first, past = -1.0, np.inf
        direction, image = np.zeros_like(solution), np.zeros_like(solution)
        for _ in range(self._ITERATIONS):
            scaled = self._scale * residual
            product = self._gram_times(scaled)
            size, curvature = self._dots((residual, scaled), (scaled, product))
            first = size if first < 0 else first
            # Converged, or the residual is that of equal or contradicting rows.
            if size <= self._RESIDUAL**2 * first or curvature <= self._SINGULAR * size:
                break
            direction, image = scaled + curvature / past * direction, product + curvature / past * image
            (length,) = self._dots((image, self._scale * image))
            step, past = curvature / length, curvature
            solution, residual = solution + step * direction, residual - step * image
        else:
            raise SolveError(
                f"the projection onto closed contact has not converged in {self._ITERATIONS} iterations: rows of "
                "contact are almost dependent, as on surfaces of several contacts or ties that share an edge, or on "
                "facets of very different sizes"
            )
        return solution

    def _gram_times(self, values: FloatArray) -> FloatArray:
        return np.where(self.closed, self._jump.matrix.times_transposed(self._weighted, values), 0.0)

    def _dots(self, *factors: tuple[FloatArray, FloatArray]) -> FloatArray:
        return self._comm.allreduce(np.array([a @ b for a, b in factors]))


def _weights(rows: ConstraintRows) -> FloatArray:
    """W at the entries (b,), the mean at each node: rows of bonded parts share nodes.  Collective."""
    entries, kinds = rows.entries, np.array([[1.0, kind.FOLLOWED] for kind in rows.kinds])
    weight = kinds[rows.contact[entries.row], entries.side] * rows.modulus[entries.row, entries.side]
    sums = rows.prolongation.zeros(2)
    np.add.at(sums, entries.node, np.column_stack([weight, np.ones_like(weight)]))
    total, count = rows.prolongation.ghosted(rows.prolongation.summed(sums))[entries.node].T
    return np.asarray(total / count)
