"""Stresses by values at nodes: continuous inside each material of a body, which jump between materials."""

import numpy as np
from dolfinx import fem
from scipy.sparse import csr_matrix

from fx_contact.fem.nodal_spaces import NodalSpaces
from fx_contact.parallel.arrays import FloatArray, IntArray


class NodalStress:
    """Fields of the displacement's degree with a value at each node and for each layer of cells with it.

    Between layers, which are materials of one body, they jump.  Leaves on both sides of a hanging facet are in one
    layer, or have the masters of its nodes in both: P interpolates inside each layer.

    Args:
        layer: (ncells,), layer of each local cell.
        count: number of layers on all ranks.
    """

    def __init__(self, spaces: NodalSpaces, layer: IntArray, count: int) -> None:
        self._spaces, self._prolongation, self._count = spaces, spaces.prolongation, count
        self._place: IntArray = spaces.node_of_block
        self._gather = spaces.gather
        if count > 1:
            nodes = spaces.cells[:, spaces.order]
            self._place = (nodes * count + layer[:, None]).ravel()
            entries = np.ones(len(self._place)), (self._place, np.arange(len(self._place)))
            self._gather = csr_matrix(entries, shape=(count * len(self._prolongation.space), len(self._place)))

    def space(self, *shape: int) -> fem.FunctionSpace:
        """Functions with components of a shape, discontinuous if there are several layers.  Collective."""
        return self._spaces.space_of(*shape, discontinuous=self._count > 1)

    def restrict(self, moments: FloatArray) -> FloatArray:
        """Sums (owned, count, k) of assembled moments with a space of k components.  Collective."""
        k = len(moments) // len(self._place)
        sums = (self._gather @ moments.reshape(-1, k)).reshape(-1, self._count * k)
        return self._prolongation.restrict(sums).reshape(-1, self._count, k)

    def array(self, values: FloatArray) -> FloatArray:
        """Array of a Function of a space of k components, of values (owned, count, k).  Collective."""
        nodal = self._prolongation.prolong(values.reshape(len(values), self._count * values.shape[2]))
        return np.asarray(nodal.reshape(-1, values.shape[2])[self._place].ravel())
