"""Unloaded bodies are moved as a whole before anything is solved."""

import numpy as np
import pytest
from conftest import WORLD, everywhere
from mpi4py import MPI

from fx_contact import Material, adapt
from fx_contact.law import contact_solver
from fx_contact.scenes import punch, stack


@pytest.fixture
def moved(monkeypatch):
    """A list that gets the displacements before and after the bodies are moved, and what is free."""
    found, move = [], contact_solver.move_bodies

    def seen(bodies, *given):
        result = move(bodies, *given)
        found.extend([given[-1], result, bodies._supports.free])
        return result

    monkeypatch.setattr(contact_solver, "move_bodies", seen)
    return found


@pytest.mark.parametrize("ratio", [1e-6, 1.0, 1e6])
def test_a_stiff_body_takes_a_soft_one_along(ratio, moved):
    """The energy is not left in one layer of a stiff body's cells; what is prescribed stays."""
    scene = stack((Material(1.0, 0.3), Material(ratio, 0.3)), cells=(2, 2, 2))
    step, *_ = list(adapt(scene, 0.3))
    (before, after, free), norm = moved, step.elasticity.energy_norm
    energy = step.estimate.energy_norm
    assert norm(after) < min(3 * energy, norm(before))
    assert norm(before) > 2e3 * energy or ratio < 1e6
    everywhere((before == after)[~free].all(), "a prescribed displacement has changed")


@pytest.mark.ranks(2, 3)
def test_a_body_that_contact_holds(moved):
    """A force moves it towards the contact, by about what it takes, whatever the number of ranks."""
    step = next(adapt(punch(force=1e-3), 0.3))
    three = *moved[:2], step.solution.displacement
    high = [WORLD.allreduce(float(np.abs(u).max(initial=0.0)), op=MPI.MAX) for u in three]
    assert high[0] == 0 < high[1] < 100 * high[2]
    next(adapt(punch(force=1e-3), 0.3, MPI.COMM_SELF))
    assert high[1] == pytest.approx(np.abs(moved[4]).max(), rel=1e-9)
