"""Prescribed displacements: which conforming vertices a named surface, curve or vertex has."""

import numpy as np
import pytest
from conftest import DISTRIBUTIONS, WORLD, everywhere, grown, roots, vertex_positions

from fx_contact.conditions import prescribed_displacements
from fx_contact.hanging import Prolongation

from fx_contact.scenes import hertz, indentation


@pytest.mark.parametrize("distribution", list(DISTRIBUTIONS))
@pytest.mark.parametrize(
    "scene, axis",
    [(hertz(order=2, coarse=2, symmetry="full"), 0.0), (indentation(coarse=4, symmetry="full"), 0.0)],
    ids=["hertz", "indentation"],
)
def test_curves(scene, axis, distribution):
    """Sideways conditions along the axis and a side hold all conforming vertices there, and no others."""
    forest = DISTRIBUTIONS[distribution](grown(roots(scene), 2))
    prolongation = Prolongation(forest)
    assert prolongation.hanging_global > 0
    prescribed = prescribed_displacements(scene, forest, prolongation)
    own = (prolongation.conforming >= 0) & (prolongation.conforming < prolongation.owned)
    position = np.empty((prolongation.owned, 3))
    position[prolongation.conforming[own]] = vertex_positions(forest)[own]
    on_axis = np.abs(position[:, :2] - axis).max(axis=1) < 1e-9
    everywhere(((~np.isnan(prescribed[:, 0])) == on_axis).all(), "x is not held just along the axis")
    held = WORLD.allreduce(int((~np.isnan(prescribed[:, 1])).sum()))
    assert held > WORLD.allreduce(int(on_axis.sum())) > 5, "y is held along a side too"
    everywhere((np.abs(position[~np.isnan(prescribed[:, 1]), 1]) < 1e-9).all(), "y is held off the plane y = 0")
