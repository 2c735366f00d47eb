"""Rows of B: solves need nothing else of a contact; normals, stiffness and forces of node pairs."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import (
    DISTRIBUTIONS,
    corner_scene,
    grown,
    pressed,
    prolongation_of,
    roots,
    side_by_side,
    solved,
    two_boxes,
    with_rows,
)
from mpi4py import MPI

from fx_contact import Enforcement
from fx_contact.contact.enforcement import CAP
from fx_contact.contact.row_entries import Entries
from fx_contact.contact.row_kinds import create_rows
from fx_contact.scenes import hertz

pytestmark = pytest.mark.ranks(1, 2, 3)


def pairs_of(scene, enforcement=None, rounds=2, degree=1):
    """NodePairs on a randomly refined forest, along the contact-aware curve."""
    forest = DISTRIBUTIONS["contact-sfc"](grown(roots(scene), rounds, share=0.2))
    return create_rows(scene, prolongation_of(scene, forest, degree), enforcement or Enforcement())


@pytest.mark.parametrize("symmetry", [1, 4])
def test_how_hard_a_punch_presses(symmetry):
    """F, and F / (E* A^(1/2)) of the whole body, of which a quarter has a quarter of F and A."""
    scene = pressed(two_boxes())
    pairs = replace(pairs_of(scene), symmetry=symmetry)
    pressure, compliance = 0.01, sum(1 / m.plane_strain_modulus for m in scene.materials.values())
    force, approach = pairs.force_and_approach(pressure * pairs.area, pairs.contact, 2)
    whole = 4 * symmetry  # m^2
    assert np.allclose(force, [4 * pressure, 0.0], rtol=1e-12)
    assert np.allclose(approach, [pressure * whole * compliance / np.sqrt(whole), 0.0], rtol=1e-12)


def test_only_what_presses_counts():
    """Pairs without force have no part in the area that presses."""
    pairs = pairs_of(pressed(two_boxes()))
    left = pairs.position[:, 0] < 0.5
    force, approach = pairs.force_and_approach(np.where(left, pairs.area, -1.0), pairs.contact, 1)
    area = WORLD.allreduce(float(pairs.area[left].sum()))
    compliance = (1 / pairs.modulus).sum(axis=1)
    assert 0 < area < 4 and abs(force[0] / area - 1) < 1e-12
    everywhere(np.allclose(approach[0], np.sqrt(area) * compliance), "another area")


@pytest.mark.parametrize("degree", [1, 2])
def test_normals_are_the_mean_of_both_surfaces(degree):
    """Between two equal half-spheres it is the axis, though neither surface is across it; at middles of facets too."""
    scene = hertz(order=2, coarse=3)
    pairs = pairs_of(scene, rounds=1, degree=degree)
    everywhere((pairs.entries.node < pairs.prolongation.owned).all(), "a node of another rank")
    everywhere(np.abs(pairs.normal - [0.0, 0.0, 1.0]).max(initial=0.0) < 1e-9, "not along the axis")
    aside = np.linalg.norm(pairs.position[:, :2], axis=1)
    gap = 2 * (1 - np.sqrt(np.maximum(1 - aside**2, 0.0)))
    everywhere(np.abs(pairs.gap - gap).max(initial=0.0) < 1e-3, "not the distance of two spheres")


def test_normals_across_an_edge_stay_apart():
    """Surfaces that meet at right angles keep their normals, also at the vertices that they share."""
    pairs = pairs_of(corner_scene())
    everywhere(np.abs(np.abs(pairs.normal).max(axis=1) - 1).max(initial=0.0) < 1e-12, "a normal between two surfaces")


def test_normals_of_two_pairs_on_a_smooth_surface():
    """Pairs that meet at 10 degrees share the mean normal along the seam, and keep their own beside it."""
    scene, slope = side_by_side(), np.tan(np.radians(5.0))
    x, y, z = scene.mesh.points.T
    scene = replace(scene, mesh=replace(scene.mesh, points=np.stack([x, y, z - slope * np.abs(x - 1)], axis=1)))
    pairs = pairs_of(scene)
    beside = np.sign(pairs.position[:, 0] - 1) * (np.abs(pairs.position[:, 0] - 1) > 1e-9)
    tilt = np.radians(5.0) * beside
    expected = np.stack([np.sin(tilt), 0 * tilt, np.cos(tilt)], axis=1)
    everywhere(np.abs(pairs.normal - expected).max(initial=0.0) < 1e-9, "another normal")
    assert WORLD.allreduce(int((beside == 0).sum())) > 2


@pytest.mark.parametrize("factor", [5.0, 100.0, 1e6])
def test_stiffness_in_the_matrix(factor):
    """Soft springs are in the matrix as they are; of stiffer ones those of pairs that are held."""
    pairs = pairs_of(pressed(two_boxes()), Enforcement("penalty", factor))
    relative = pairs.capped_stiffness / pairs.stiffness * pairs.penalty_factor
    expected = np.minimum(pairs.penalty_factor, CAP)
    everywhere(np.allclose(relative, expected, rtol=1e-12), "another stiffness")
    # c E*/h times the area of a node: for facets of one size c of all pairs that have four of them.
    assert WORLD.allreduce(int((np.abs(pairs.penalty_factor / factor - 1) < 1e-9).sum())) > 0


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
    elasticity, pairs, supports = with_rows(scene, DISTRIBUTIONS[distribution](roots(scene)))
    rows = mixed(pairs)
    one, other = (solved(elasticity, some, supports) for some in (pairs, rows))
    everywhere(one.active.all() and other.active.all(), "a row that is open")
    unlike = (
        bool(len(pairs)) and np.ptp(one.force / other.force) > 0.01
    )  # a rank with one row has none to mix it with
    assert WORLD.allreduce(bool(unlike), op=MPI.LOR), "rows that are not mixed"
    # Rounding is that of all ranks: it does not depend on their number, though some have nothing.
    alone = solved(*with_rows(scene, roots(scene, MPI.COMM_SELF)))
    assert abs(one.rounding / alone.rounding - 1) < 1e-6
    everywhere(np.abs(one.displacement - other.displacement).max(initial=0) < 2e-12, "other displacements")
    forces = pairs.transposed(one.force), rows.transposed(other.force)
    everywhere(np.allclose(*forces, rtol=0, atol=1e-10), "other forces")


def test_jump_of_translations():
    """B of a translation is exactly 0, however far it goes, and of the first body alone it is n . t."""
    scene = pressed(two_boxes(bend=0.3))
    _, pairs, _ = with_rows(scene, roots(scene))
    far = np.broadcast_to([1e9, -3e8, 7e8], (pairs.prolongation.owned, 3))
    everywhere((pairs.jump(far) == 0).all(), "a jump of a translation")
    first = np.zeros_like(far)
    own = pairs.first[pairs.first < pairs.prolongation.owned]
    first[own] = far[own]
    everywhere(np.allclose(pairs.jump(first), pairs.normal @ far[0] if len(far) else 0.0), "another jump")
