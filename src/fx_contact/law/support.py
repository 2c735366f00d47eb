"""Support of bodies that loads drive: motions that closed rows leave them, and rates at which they reach other rows."""

from typing import NamedTuple

import numpy as np
import scipy  # loads its modules where they are used

from fx_contact.contact.constraint_rows import ConstraintRows, Role
from fx_contact.contact.row_motions import RowMotions
from fx_contact.fem.body_motions import UNRESISTED, FreeMotions
from fx_contact.law.free_motions import LoadedMotions
from fx_contact.parallel.arrays import BoolArray, FloatArray

#: Part of the loads that may be left: free motions have up to 1e-4 of them.
_CARRIED = 1e-3


class Resisting(NamedTuple):
    """Rows that resist motions.

    Attributes:
        closed: (n,), rigid rows.
        sticks: (n,), and tangents that slip, with a bounded force.
        direction: (n, 3).
    """

    rows: ConstraintRows
    closed: BoolArray
    sticks: BoolArray
    direction: FloatArray


class Support:
    """Motions that rows leave to free bodies, with loads on them.

    Args:
        motions: of sections and faces, which give way.
    """

    def __init__(self, loaded: LoadedMotions, motions: RowMotions) -> None:
        self._loaded, self._motions = loaded, motions

    def left_out(self, by: Resisting) -> FreeMotions | None:
        """The projector that leaves free motions out; None: there are none.  Collective."""
        return self._loaded.left_out(self._free(by)[0])

    def free(self, by: Resisting, u: FloatArray) -> tuple[dict[str, str], FloatArray]:
        """Bodies that nothing holds and no load moves, by name, and how; a displacement (owned, 3) without it [m].

        Collective.
        """
        free = self._free(by)[0]
        projector = self._loaded.projector(free)
        return self._loaded.named(free), u if projector is None else projector.remaining(u)

    def driven(self, by: Resisting) -> dict[str, str]:
        """Bodies that loads move without resistance, or that slide, and how.  Collective."""
        return self._loaded.driven(*self._free(by))

    def rates(self, by: Resisting) -> tuple[FloatArray, float]:
        """Rates (n,) of penetration as loads drive bodies, and how far, as by `LoadedMotions.motion`.  Collective."""
        motion, way = self._loaded.motion(*self._free(by))
        return self._penetration(by, np.full(len(by.closed), True)) @ motion, way

    def gaps(self, by: Resisting) -> FloatArray:
        """Gaps (n,) of the rows once the undeformed bodies close the rigid ones, in least squares [m].  Collective."""
        every = self._penetration(by, np.full(len(by.closed), True))
        closed, gap = every[by.closed], by.rows.gap
        sums = self._motions.sum(np.column_stack([closed.T @ closed, closed.T @ gap[by.closed]]))
        return np.asarray(gap - every @ (np.linalg.pinv(sums[:, :-1], UNRESISTED, True) @ sums[:, -1]))

    def carries(self, by: Resisting) -> bool:
        """True if the rigid rows, normals by pressing, balance the loads on undeformed bodies.  Collective."""
        rates, normal = self._penetration(by, by.closed), (by.rows.role == Role.NORMAL)[by.closed]
        comm = by.rows.prolongation.comm
        both = [np.concatenate(comm.allgather(part)) for part in (rates, -rates[~normal])]
        _, left = scipy.optimize.nnls(np.concatenate(both).T, self._loaded.work)
        return bool(left <= _CARRIED * np.linalg.norm(self._loaded.work))

    def _free(self, by: Resisting) -> tuple[FloatArray, FloatArray]:
        """Free motions, as of `LoadedMotions`, and all that rigid rows do not resist."""
        loose = held = self._unresisted(by, by.closed)
        if by.sticks is not by.closed:
            held = self._unresisted(by, by.sticks)
        pairs = by.rows.bodies[by.closed & (by.rows.bodies >= 0).all(axis=1)]
        joined = np.zeros(2 * (len(self._loaded.rigid.free[0]),))
        joined[tuple(pairs.T)] = 1.0
        return self._loaded.free(held, self._motions.sum(joined)), loose

    def _unresisted(self, by: Resisting, closed: BoolArray) -> FloatArray:
        """Motions that closed rows (n,) do not resist."""
        resisted = self._penetration(by, closed)
        return self._loaded.rigid.unresisted(self._motions.sum(resisted.T @ resisted))

    def _penetration(self, by: Resisting, some: BoolArray) -> FloatArray:
        """Rates (l, k + m) of penetration of some rows (n,) in the motions."""
        rows, along, rigid = by.rows, by.direction[some], self._loaded.rigid
        first, second = (rigid.free_along(rows.position[some], one, along) for one in rows.bodies[some].T)
        return np.hstack([first - second, self._motions.rates[:, some].T])
