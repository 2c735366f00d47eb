"""Facets of the first surface at the rim of the second one, for the mean pressures there (`rim_pressure`)."""

from dataclasses import dataclass

import numpy as np

from fx_contact.fem.prolongation import Prolongation
from fx_contact.parallel.arrays import BoolArray, FloatArray, Int64Array


@dataclass(frozen=True, eq=False)
class Rim:
    """This rank's facets (m,) around nodes at the rim of one contact.

    Attributes:
        nodes: (m, (p+1)^2), conforming nodes, positions in the index map.
        moments: (m, (p+1)^2, (p+1)^2), int_C W_j psi_k, 0 for nodes j that are not at the rim [m^2].
        area: (m, (p+1)^2), int_C W_j, likewise [m^2].
    """

    nodes: Int64Array
    moments: FloatArray
    area: FloatArray

    @classmethod
    def of(
        cls, prolongation: Prolongation, nodes: Int64Array, crossed: BoolArray, moments: FloatArray, area: FloatArray
    ) -> "Rim":
        """Of all facets (n,), by their columns, those around the nodes of crossed ones (n,).  Collective."""
        marks = prolongation.zeros(1)
        marks[nodes[crossed[:, None] & (area > 0)]] = 1.0
        ours = (prolongation.ghosted(prolongation.summed(marks))[nodes, 0] > 0) & (area > 0)
        some = ours.any(axis=1)
        return cls(nodes[some], np.where(ours[some][:, :, None], moments[some], 0.0), np.where(ours, area, 0.0)[some])
