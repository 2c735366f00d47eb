"""Entries of the rows of B: weights of nodes in the jump of each row.  All is local."""

from dataclasses import dataclass

import numpy as np

from fx_contact.parallel.arrays import FloatArray, Int64Array


@dataclass(frozen=True, eq=False)
class Entries:
    """Weights of nodes in the jump [u] of each row, the sum of weight times u.

    Attributes:
        row: (b,), local number of the row, ascending.
        node: (b,), position in the prolongation's index map.
        side: (b,), 0 where the node is on the first surface, 1 on the second.
        weight: (b,) [-]; those of a row add up to 1 on the first surface, and to -1 on the second, if any.
    """

    row: Int64Array
    node: Int64Array
    side: Int64Array
    weight: FloatArray

    def sums(self, values: FloatArray, count: int) -> FloatArray:
        """Sums of values (b,) over the entries of each of `count` rows: (count,)."""
        return np.bincount(self.row, values, count).astype(float)  # without rows NumPy counts in integers


@dataclass(frozen=True, eq=False)
class KeyedEntries:
    """As `Entries`, of nodes by their lattice keys; they may hang, and be of any rank.

    Attributes:
        key: (b,).
    """

    row: Int64Array
    key: Int64Array
    side: Int64Array
    weight: FloatArray
