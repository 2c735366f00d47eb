"""Coulomb's and Tresca's law of friction: stick and slip by a semismooth Newton method.

Of the force f and the slip d of the last solution, p = f + c d is the trial force, and g the bound of |f| by the last
normal force f_n: mu f_n (Coulomb), or the smaller one of f_n and a constant (Tresca).  Nodes with |p| > g slip, with
the force g e along e = p / |p|.  Across e they have a spring

    kappa = g c / (|p| - g),

by the derivative of g p / |p|; it has no force in the solution.  Others stick, d = 0, also those whose slip runs
against their force.  The bound lags by one solution, in place of its derivative by f_n, which is not symmetric.  While
no status changes, Anderson's method accelerates the convergence of the bounds.

Sources: S. Hueeber, G. Stadler, B. Wohlmuth, SIAM J. Sci. Comput. 30(2), 2008; H. F. Walker, P. Ni, SIAM J. Numer.
Anal. 49(4), 2011.
"""

import numpy as np
from mpi4py import MPI

from fx_contact.contact.constraint_rows import ConstraintRows, Role
from fx_contact.contact.contact_system import Springs
from fx_contact.items.friction import Friction, TangentialLaw
from fx_contact.law.tangents import TangentialStatus
from fx_contact.parallel.arrays import BoolArray, FloatArray

#: Depth of Anderson's method (`studies.cost.friction`).
_DEPTH = 2


class FrictionStatus(TangentialStatus):
    """Stick or slip of m nodes, all of which stick at first.

    Attributes:
        slips: (m,).
        bound: (m,), g of nodes that slip, else 0 [N].
    """

    def __init__(self, law: TangentialLaw, rows: ConstraintRows, ours: BoolArray, history: FloatArray) -> None:
        super().__init__(law, rows, ours, history)
        # Tangents t1 and t2 are in the order of their normals.
        self._pair = np.stack([np.flatnonzero(ours & (rows.axis == axis)) for axis in (1, 2)], axis=1)
        normals, contact = rows.role == Role.NORMAL, np.unique(rows.contact[ours])
        self._normal = np.flatnonzero(normals & np.isin(rows.contact, contact))
        self._axes, self._shift = rows.normal[self._pair], history[self._pair]
        self._stiffness = rows.capped_stiffness[self._normal]
        count = len(self._pair)
        self.slips: BoolArray = np.zeros(count, dtype=bool)
        self.bound: FloatArray = np.zeros(count)
        self._along: FloatArray = np.tile([1.0, 0.0], (count, 1))
        self._across: FloatArray = np.zeros(count)
        self._points: list[FloatArray] = []  # (2, m), bounds and their changes by a solution

    def _turned(self, values: FloatArray) -> FloatArray:
        """Components along and across e (m, 2, ...) of those along t1 and t2."""
        x, y = self._along.T.reshape(2, -1, *[1] * (values.ndim - 2))
        return np.stack([x * values[:, 0] + y * values[:, 1], x * values[:, 1] - y * values[:, 0]], axis=1)

    def turn(self, direction: FloatArray) -> None:
        """As `TangentialStatus.turn`."""
        direction[self._pair] = self._turned(self._axes)

    def turn_back(self, force: FloatArray) -> None:
        """As `TangentialStatus.turn_back`."""
        (x, y), (along, across) = self._along.T, force[self._pair].T
        force[self._pair] = np.stack([x * along - y * across, y * along + x * across], axis=1)

    def slipping(self) -> BoolArray:
        """As `TangentialStatus.slipping`."""
        result = np.zeros(len(self.rows), dtype=bool)
        result[self._normal] = self.slips
        return result

    def springs(self, active: BoolArray) -> Springs:
        """As `TangentialStatus.springs`."""
        stiffness, shift, force = np.zeros((3, len(self.rows)))
        closed = active[self._normal]
        of_slip = np.stack([np.zeros_like(self._across), self._across], axis=1)
        stiffness[self._pair] = np.where(closed[:, None], np.where(self.slips[:, None], of_slip, np.inf), 0.0)
        force[self._pair[:, 0]] = np.where(closed & self.slips, self.bound, 0.0)
        shift[self._pair] = self._turned(self._shift)
        return Springs(stiffness, shift, force)

    def _accelerated(self, bound: FloatArray, changed: bool) -> FloatArray:
        """Bounds (m,) [N] closer to the fixed point, by those since the last change of a status.  Collective."""
        comm = self.rows.prolongation.comm
        if comm.allreduce(changed, op=MPI.LOR):
            self._points = []
            return bound
        self._points = [*self._points, np.stack([self.bound, bound - self.bound])][-_DEPTH - 1 :]
        if len(self._points) < 2:
            return bound
        steps, residuals = np.diff(self._points, axis=0).swapaxes(0, 1)
        scaled = residuals / self._stiffness
        products = comm.allreduce(scaled @ np.column_stack([residuals.T, bound - self.bound]))
        factors = np.linalg.lstsq(products[:, :-1], products[:, -1], rcond=None)[0]
        return np.maximum(bound - factors @ (steps + residuals), 0.0)

    def update(self, force: FloatArray, jump: FloatArray, active: BoolArray, noise: float) -> FloatArray:
        """As `TangentialStatus.update`.  A node keeps its status if |p| differs from g by less than the noise."""
        closed, c = active[self._normal], self._stiffness
        f, d = force[self._pair], np.where(self.slips[:, None], jump[self._pair] - self._shift, 0.0)
        p = f + c[:, None] * d
        normals = self._normal
        assert isinstance(self.law, Friction)
        pressed, pulled = (self.law.bounds(sign * force[normals], self.rows.area[normals]) for sign in (1, -1))
        bound = np.where(closed, pressed, 0.0)
        size = np.linalg.norm(p, axis=1)
        slips = size > bound + np.where(self.slips, -noise, noise) * np.sqrt(c)
        slips &= ~(self.slips & (np.einsum("ni,ni->n", d, f) < 0))
        slips |= ~closed
        before, some = np.where((closed & self.slips)[:, None], self.bound[:, None] * self._along, f), slips[:, None]
        changed = closed & (slips != self.slips)
        forces = np.where(slips, bound, 0.0)
        others = (slips != self.slips) | ((forces > 0) != (self.bound > 0))  # also where a node closes or opens
        self.slips, self.bound = slips, self._accelerated(forces, bool(others.any()))
        self._along = np.where(some, p / np.maximum(size, np.finfo(float).tiny)[:, None], [1.0, 0.0])
        excess = np.maximum(size - self.bound, np.finfo(float).eps * size)
        self._across = np.divide(self.bound * c, excess, out=np.zeros_like(bound), where=slips & (excess > 0))
        change = np.where(some, forces[:, None] * self._along - before, 0.0)
        energy = (change**2 / c[:, None]).sum()
        return np.array([np.count_nonzero(changed), energy, (pressed - pulled)[closed].sum()], dtype=np.float64)
