"""Checks of friction that several tests share: the law at each node, tractions, resultants."""

import numpy as np
from conftest import WORLD, everywhere
from mpi4py import MPI

from fx_contact.contact.constraint_rows import Role
from fx_contact.law.tangents import tangential_vectors


def forces(step):
    """Tangential forces (n, 3) of this rank's nodes [N]."""
    return tangential_vectors(step.solution.rows, step.solution.row_force)


def tractions(step):
    """Tangential tractions (n, 3) of this rank's nodes [Pa]."""
    return forces(step) / step.solution.rows.part(Role.NORMAL).area[:, None]


def total(values):
    """Sum over all ranks."""
    return WORLD.allreduce(float(values.sum()))


def largest(values):
    """Largest value of all ranks."""
    return WORLD.allreduce(float(values.max(initial=-np.inf)), op=MPI.MAX)


def resultant(step, kind="contact", number=0):
    """Resultant of one kind, by its number among them."""
    return [one for one in step.resultants if one.kind == kind][number]


def contact_force(step, number=0):
    """Force vector of a contact on the second side."""
    return np.array(resultant(step, number=number).force)


def check_law(step, accuracy=1e-6):
    """|t| <= mu p, slip along the force, stick elsewhere, in each contact; accuracy: relative to the largest force."""
    rows, solution, pairs = step.solution.rows, step.solution, step.scene.contact
    scale = largest(solution.row_force[rows.role == Role.NORMAL])
    closed = np.zeros_like(solution.active)
    for number, law in ((i, pair.tangential) for i, pair in enumerate(pairs) if pair.tangential is not None):
        normal, *tangents = (np.flatnonzero((rows.contact == number) & (rows.axis == axis)) for axis in range(3))
        force, slip = (np.stack([of[t] for t in tangents], axis=1) for of in (solution.row_force, solution.slip))
        bound, slips = law.bounds(solution.row_force[normal], rows.area[normal]), solution.slipping[normal]
        size, length = (np.linalg.norm(values, axis=1) for values in (force, slip))
        everywhere((size <= bound + accuracy * scale).all(), "more than the bound")
        everywhere((np.abs(size - bound)[slips] <= accuracy * scale).all(), "slips below the bound")
        everywhere(np.abs(slip[~slips]).max(initial=0.0) < 1e-9, "moves where it sticks")
        along = np.einsum("ni,ni->n", force, slip)
        everywhere((along >= (1 - 1e-3) * size * length - 1e-9 * scale)[slips].all(), "another direction")
        closed[normal] = solution.active[normal]
    slipping, sticking = (total(some) for some in (solution.slipping, closed & ~solution.slipping))
    assert (slipping, sticking) == (step.record.slipping_pairs, step.record.sticking_pairs)
    assert step.record.dissipated_energy >= -1e-12
    return int(slipping), int(sticking)
