"""The geometry order of a run where none is given."""

import numpy as np
import pytest
from conftest import WORLD
from model_problems import shortest
from mpi4py import MPI

from fx_contact import adapt
from fx_contact.geometry import hexahedron
from fx_contact.scenes import hertz
from studies.cost.thin import ring


def deviation(forest, order):
    """Largest distance of root maps from their interpolants of an order, over the shortest length of a cell."""
    line = np.linspace(0, 1, 13)

    def positions(points):
        return forest.mesh.evaluate(forest.cell, np.broadcast_to(points, (len(forest), 3, len(points))))

    exact, nodes = positions(line), positions(np.linspace(0, 1, order + 1))
    mapped = hexahedron.tensor_evaluate((hexahedron.lagrange(order, line),) * 3, nodes)
    size = shortest(exact)
    return WORLD.allreduce((np.linalg.norm(mapped - exact, axis=2).max(axis=1) / size).max(), MPI.MAX)


def test_a_thin_ring_keeps_its_shape():
    """Cells that are straight for their width would be bent for their thickness: more and more of them did not do."""
    *_, last = (step.record for step in adapt(ring(), 0.1, max_steps=4))
    assert last.reached and last.geometry_order > 1 and last.dofs < 20_000
    assert abs(last.force / 1.2076e-9 - 1) < 0.01  # this program's at 2 %


@pytest.mark.parametrize("tolerance", [0.2, 0.04, 0.01])
def test_leaf_maps_are_a_tenth_of_the_tolerance_off(tolerance):
    """Of the leaf's shortest length at most, and one order less would be more."""
    step = next(adapt(hertz(order=6, coarse=2), tolerance, max_steps=1))
    order = step.record.geometry_order
    assert order > 1 and step.record.max_level == 0
    assert deviation(step.forest, order) <= 1.5 * 0.1 * tolerance
    assert deviation(step.forest, order - 1) > 0.1 * tolerance
