"""Unknown motions of the interfaces of rows along given forces: w_i . f = F_i (`items.motions`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fx_contact.contact.constraint_rows import ConstraintRows, RowKind
from fx_contact.parallel.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class RowMotions:
    """All unknown motions of obstacles, which turn normals, or all of sections and faces, which do not.

    Attributes:
        kinds: with such motions.
        interface: (k,), index of the interface of each motion.
        rates: (k, n), w, penetration of the rows in each motion [-].
        loads: (k,), F of the modelled part [N].
    """

    rows: ConstraintRows
    kinds: tuple[RowKind, ...]
    interface: IntArray
    rates: FloatArray
    loads: FloatArray

    @classmethod
    def of(cls, rows: ConstraintRows, turning: bool) -> RowMotions:
        """The motions of rows.  Local."""
        moved = [(kind, kind.contact.motion) for kind in rows.kinds]
        known = [(kind, motion) for kind, motion in moved if motion is not None and motion.TURNS == turning]
        loads = [np.asarray(motion.loads) for _, motion in known]
        rates = np.zeros((sum(map(len, loads)), len(rows.role)))
        interface = np.repeat([kind.index for kind, _ in known], list(map(len, loads))).astype(np.int64)
        for kind, motion in known:
            ours = rows.contact == kind.index
            rates[np.ix_(interface == kind.index, ours)] = motion.rates(rows.normal[ours], rows.position[ours])
        given = np.concatenate([np.zeros(0), *loads]) / rows.symmetry
        return cls(rows, tuple(kind for kind, _ in known), interface, rates, given)

    def __len__(self) -> int:
        return len(self.loads)

    @property
    def moving(self) -> BoolArray:
        """(n,), rows that penetrate in a motion.  Local."""
        return np.asarray((self.rates != 0).any(axis=0))

    def spread(self) -> FloatArray:
        """Forces a w^T (w a w^T)^-1 F (n,) [N] with w . f = F, a the areas of the rows.  Collective."""
        weighted = self.rows.area * self.rates
        return np.asarray(np.linalg.solve(self.sum(weighted @ self.rates.T), self.loads) @ weighted)

    def found(self, penetration: FloatArray) -> FloatArray:
        """t (k,) [m] with the least B u - D + w^T t, by penetrations B u - D (n,) [m].  Collective."""
        weighted = self.rows.area * self.rates
        sums = self.sum(np.column_stack([weighted @ self.rates.T, weighted @ -penetration]))
        return np.asarray(np.linalg.solve(sums[:, :-1], sums[:, -1]))

    def sum(self, values: FloatArray) -> FloatArray:
        """Sums over all ranks.  Collective."""
        total = np.ascontiguousarray(values, dtype=np.float64)
        self.rows.prolongation.comm.Allreduce(MPI.IN_PLACE, total)
        return total

    def entries(self, t: FloatArray) -> dict[str, float | list[float]]:
        """Entries of `StepRecord.motions` for t (k,) [m].  Local."""
        named = ((kind, kind.contact.motion) for kind in self.kinds)
        return {
            kind.scene.interfaces[kind.index].name: motion.entry(t[self.interface == kind.index])
            for kind, motion in named
            if motion is not None
        }
