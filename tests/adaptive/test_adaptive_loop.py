"""The steps of a run: how many, and where each begins."""

import numpy as np
from conftest import WORLD
from model_problems import pressed, two_boxes
from mpi4py import MPI

from fx_contact import adapt


def test_each_step_begins_where_the_last_has_ended():
    """A run has as many steps as it may; the first guess of a step has the energy of the solution before."""
    steps = list(adapt(pressed(two_boxes()), 1e-3, max_steps=2))
    assert len(steps) == 2 and not steps[1].record.reached
    assert WORLD.allreduce(np.abs(steps[0].start).max(initial=0.0), MPI.MAX) == 0
    first, second = (
        step.elasticity.energy_norm(u) for step, u in zip(steps, (steps[0].solution.displacement, steps[1].start))
    )
    assert abs(second / first - 1) < 1e-5  # other Gauss points
