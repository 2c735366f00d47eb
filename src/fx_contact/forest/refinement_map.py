"""Relation between a forest and its refinement."""

from dataclasses import dataclass

import numpy as np

from fx_contact.parallel.arrays import FloatArray, Int8Array, Int64Array
from fx_contact.problem import hexahedron


@dataclass(frozen=True, eq=False)
class RefinementMap:
    """Parent and child of each leaf of a refined forest; a leaf and its parent are on the same rank.

    Attributes:
        parent: (n,), index of the leaf before refinement.
        child: (n,), number of the leaf among the children of its parent, -1 where the parent was not refined.
    """

    parent: Int64Array
    child: Int8Array

    def interpolated(self, values: FloatArray) -> FloatArray:
        """Nodal values (n, (p+1)^3, ...) of a field of degree p, from those before refinement.  Local; exact."""
        result: FloatArray = values[self.parent]
        for child, interpolation in enumerate(hexahedron.child_interpolation(hexahedron.order_of(values.shape[1]))):
            rows = self.child == child
            result[rows] = np.einsum("ij,nj...->ni...", interpolation, result[rows])
        return result
