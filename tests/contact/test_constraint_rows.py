"""What solves with contact needs rows of B alone: those of node pairs, and others with more vertices."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import DISTRIBUTIONS, discrete, pressed, roots, solved, two_boxes
from mpi4py import MPI

from fx_contact.contact.constraint_rows import Entries
from fx_contact.contact.enforcement import Enforcement
from fx_contact.contact.row_kinds import create_rows
from fx_contact.fem.dirichlet import find_supports


def mixed(pairs):
    """0.9 of each node pair's row and 0.1 of the next one's, of equal normals: the same constraints, if all are met."""
    n, one = len(pairs), pairs.entries
    following = np.roll(np.arange(n), -1)
    row = np.concatenate([one.row, np.argsort(following)[one.row]])
    order = np.argsort(row, kind="stable")
    weight = np.concatenate([0.9 * one.weight, 0.1 * one.weight])
    entries = Entries(row[order], np.tile(one.node, 2)[order], np.tile(one.side, 2)[order], weight[order])
    return replace(pairs, entries=entries, gap=0.9 * pairs.gap + 0.1 * pairs.gap[following])


@pytest.mark.parametrize("distribution", list(DISTRIBUTIONS))
def test_rows_of_four_vertices(distribution):
    """Mixed rows let the bodies move as the rows of node pairs do, and their forces act alike."""
    scene = pressed(two_boxes(margin=1))
    forest = DISTRIBUTIONS[distribution](roots(scene))
    elasticity, enforcement = discrete(scene, forest), Enforcement()
    prolongation = elasticity.prolongation
    pairs = create_rows(scene, prolongation, enforcement)
    rows, supports = mixed(pairs), find_supports(scene, forest, prolongation)
    one, other = (solved(elasticity, some, supports, enforcement) for some in (pairs, rows))
    everywhere(one.active.all() and other.active.all(), "a row that is open")
    unlike = (
        bool(len(pairs)) and np.ptp(one.force / other.force) > 0.01
    )  # a rank with one row has none to mix it with
    assert WORLD.allreduce(bool(unlike), op=MPI.LOR), "rows that are not mixed"
    # Rounding is that of all ranks: it does not depend on their number, though some have nothing.
    forest = roots(scene, MPI.COMM_SELF)
    elasticity = discrete(scene, forest)
    serial = create_rows(scene, elasticity.prolongation, enforcement)
    alone = solved(elasticity, serial, find_supports(scene, forest, elasticity.prolongation), enforcement)
    assert abs(one.rounding / alone.rounding - 1) < 1e-6
    everywhere(np.abs(one.displacement - other.displacement).max(initial=0) < 2e-12, "other displacements")
    forces = pairs.transposed(one.force), rows.transposed(other.force)
    everywhere(np.allclose(*forces, rtol=0, atol=1e-10), "other forces")


def test_jump_of_translations():
    """B of a translation is exactly 0, however far it goes, and of the first body alone it is n . t."""
    scene = pressed(two_boxes(bend=0.3))
    forest = roots(scene)
    pairs = create_rows(scene, discrete(scene, forest).prolongation, Enforcement())
    far = np.broadcast_to([1e9, -3e8, 7e8], (pairs.prolongation.owned, 3))
    everywhere((pairs.jump(far) == 0).all(), "a jump of a translation")
    first = np.zeros_like(far)
    own = pairs.first[pairs.first < pairs.prolongation.owned]
    first[own] = far[own]
    everywhere(np.allclose(pairs.jump(first), pairs.normal @ far[0] if len(far) else 0.0), "another jump")
