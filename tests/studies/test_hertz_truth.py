"""True errors of HERTZ-A by an axisymmetric solution, on coarse meshes."""

import numpy as np
import pytest
from conftest import WORLD

from fx_contact import solve
from fx_contact.scenes import hertz
from studies.effectivity.hertz_truth import Truth, at_edge, errors

pytestmark = pytest.mark.skipif(WORLD.size > 1, reason="the study is a serial program")


def test_true_errors():
    """Near the estimates, of all cells and of those at the edge of the contact."""
    truth, step = Truth(20, 0.1, 1e-3), solve(hertz(displacement=0.01, order=6, coarse=2), 0.05)
    assert abs(truth.force / 5.37755e-4 - 1) < 1e-5
    squared, total = errors(step, truth)
    edge, estimated = at_edge(step), step.estimate.error**2
    assert len(squared) == step.record.cells and 0 < edge.sum() < 30
    assert 0.95 < step.record.estimate / np.sqrt(squared.sum() / total) < 1.15
    assert 0.7 < np.sqrt(estimated[edge].sum() / squared[edge].sum()) < 1.3
    assert abs(total / step.estimate.energy_norm**2 - 1) < 0.02
