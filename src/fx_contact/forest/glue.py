"""Between a forest and the one that it was refined to."""

from dataclasses import dataclass

import numpy as np

from fx_contact.problem import hexahedron


@dataclass(frozen=True)
class Glue:
    """How the leaves of a refined forest come from those before, on the same rank.

    Attributes:
        parent: (n,) int64, the leaf before.
        child: (n,) int8, which child of it, -1 where it was not refined.
    """

    parent: np.ndarray
    child: np.ndarray

    def carry(self, values):
        """Carry a field along: children take their parent's function, restricted.  Local.

        Args:
            values: (n_before, (p+1)^3, ...) float64, a field of degree p at the nodes of the leaves.

        Returns:
            (n, (p+1)^3, ...) float64.
        """
        result = values[self.parent]
        for child, interpolation in enumerate(hexahedron.child_interpolation(hexahedron.order_of(values.shape[1]))):
            rows = self.child == child
            result[rows] = np.einsum("ij,nj...->ni...", interpolation, result[rows])
        return result
