"""The geometry order of a run where none is given."""

import numpy as np
import pytest
from conftest import WORLD, everywhere
from mpi4py import MPI

from fx_contact import adapt
from fx_contact.problem import hexahedron
from fx_contact.scenes import hertz


@pytest.mark.parametrize("tolerance", [0.2, 0.04, 0.01])
def test_leaf_maps_are_a_tenth_of_the_tolerance_off(tolerance):
    """Of the leaf's size at most, and one order less would be more."""
    step = next(adapt(hertz(order=6, coarse=2), tolerance, max_steps=1))
    forest, line, off = step.forest, np.linspace(0, 1, 13), []
    everywhere((forest.level == 0).all(), "not the root cells")

    def positions(points):
        return forest.mesh.evaluate(forest.cell, np.broadcast_to(points, (len(forest), 3, len(points))))

    exact = positions(line)
    for order in (step.record.geometry_order, step.record.geometry_order - 1):
        nodes = positions(np.linspace(0, 1, order + 1)) if order else exact[:, :1]
        mapped = hexahedron.tensor_evaluate((hexahedron.lagrange(order, line),) * 3, nodes)
        size = np.linalg.norm(exact[:, -1] - exact[:, 0], axis=1) / np.sqrt(3)
        off.append(WORLD.allreduce((np.linalg.norm(mapped - exact, axis=2).max(axis=1) / size).max(), MPI.MAX))
    assert off[0] <= 0.1 * tolerance * 1.5 and off[1] > 0.1 * tolerance, off
