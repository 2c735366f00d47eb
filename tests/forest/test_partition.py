"""The four kinds of partition: pairs, balance, the same result on any number of ranks."""

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import (
    chosen,
    corner_scene,
    find_leaves,
    gathered,
    grown,
    leaves,
    pressed,
    roots,
    strewn,
    two_boxes,
)
from mpi4py import MPI

from fx_contact import Solver, adapt
from fx_contact.forest.partition import KINDS, curve_keys, repartition
from fx_contact.forest.partition_quality import PartitionSummary
from fx_contact.parallel.errors import PartitionError
from fx_contact.surfaces.facet_pairing import leaf_code
from studies.partition.assignment import assign

pytestmark = pytest.mark.ranks(1, 2, 3)

KEEPING = [name for name, kind in KINDS.items() if kind.pairs]


def code_of(forest):
    return leaf_code(forest.cell, forest.anchor)


def rank_of(forest):
    """Rank of every leaf, in ascending order of the leaves' codes, on all ranks."""
    order = np.argsort(gathered(forest.comm, code_of(forest)))
    return gathered(forest.comm, np.full(len(forest), forest.comm.rank))[order]


@pytest.mark.parametrize("kind", list(KINDS))
def test_nothing_is_lost(kind):
    """A repartition keeps the leaves and what they carry, each rank's leaves in curve order."""
    forest = grown(roots(pressed(two_boxes(margin=1))), 3)
    moved, values = repartition(forest, code_of(forest), kind)
    everywhere(np.array_equal(values, code_of(moved)), "values do not follow their leaf")
    assert np.array_equal(leaves(moved), leaves(forest))
    everywhere((np.diff(curve_keys(moved, KINDS[kind].pairs)) >= 0).all(), "leaves are not in curve order")
    everywhere(len(moved) > 0, "a rank without leaves")


@pytest.mark.parametrize("make", [lambda: pressed(two_boxes(margin=1)), corner_scene], ids=["boxes", "corner"])
@pytest.mark.parametrize("kind", list(KINDS))
def test_pairs_through_refinement(kind, make):
    """Under random refinement the kinds that keep pairs never split one, from leaves strewn over the ranks too."""
    forest = strewn(grown(roots(make()), 2))
    assert WORLD.size == 1 or PartitionSummary.of(forest, "strewn").split_pairs > 3
    for salt in range(3):
        forest, _ = repartition(forest, None, kind)
        leaf, face = forest.contact_faces()
        cell, anchor = forest.pairing.partners(forest.cell[leaf], forest.level[leaf], forest.anchor[leaf], face)
        first = ~forest.pairing.second[forest.cell[leaf], face]
        apart = WORLD.allreduce(int((find_leaves(forest, cell, anchor) < 0)[first].sum()))
        assert PartitionSummary.of(forest, kind).split_pairs == apart
        assert apart == 0 or kind not in KEEPING
        forest, _ = forest.refined(chosen(forest, 0.1, salt))
    assert WORLD.allreduce(len(leaf)) > 30


@pytest.mark.parametrize("kind", ["contact-sfc", "sfc"])
@pytest.mark.parametrize("parts", [2, 7, 50])
def test_curve_partitions_are_balanced(kind, parts):
    """No part is heavier than 1.02 times the mean, or the mean and one super-element."""
    forest = grown(roots(pressed(two_boxes(margin=1)), MPI.COMM_SELF), 5)
    units, part = assign(forest, parts, kind)
    weights = np.bincount(part, weights=units.weights, minlength=parts)
    assert units.weights.max() == 1 + KINDS[kind].pairs and weights.min() > 0
    assert weights.max() <= max(1.02 * len(forest) / parts, len(forest) / parts + units.weights.max())


@pytest.mark.parametrize("kind", ["contact-sfc", "sfc", "equidistributed"])
def test_same_parts_in_serial(kind):
    """A partition into as many parts as there are ranks, made by one rank, is the one that the ranks make."""
    scene = pressed(two_boxes(upper=(3, 3, 3), margin=1))
    forest, alone = roots(scene), roots(scene, MPI.COMM_SELF)
    home = np.repeat(np.arange(WORLD.size), WORLD.allgather(len(forest)))
    # Facing leaves first meet on the lowest rank that has one of them.
    _, group = np.unique(alone.representatives, return_inverse=True)
    lowest = np.full(len(alone), WORLD.size)
    np.minimum.at(lowest, group, home)
    home = lowest[group]
    for salt in range(3):
        forest, _ = repartition(forest, None, kind)
        units, part = assign(alone, WORLD.size, kind, home)
        home = part[units.of_leaf]
        assert np.array_equal(rank_of(forest), home[np.argsort(code_of(alone))]), f"refined {salt} times"
        forest, _ = forest.refined(chosen(forest, 0.4, salt))
        alone, children = alone.refined(chosen(alone, 0.4, salt))
        home = home[children.parent]
    assert len(alone) > 300 * WORLD.size


@pytest.mark.parametrize("parts", [2, 10, 37])
def test_equidistributed_parts(parts):
    """The same of any number of parts, each of about the same weight as those beside it."""
    forest = grown(roots(pressed(two_boxes(margin=1)), MPI.COMM_SELF), 4)
    units, part = assign(forest, parts, "equidistributed")
    masks = units.contact, ~units.contact
    contact, others = (np.bincount(part[which], units.weights[which], parts) for which in masks)
    assert not ((contact > 0) & (others > 0)).any()
    assert (contact > 0).sum() == min(max(round(parts * contact.sum() / len(forest)), 1), parts - 1)
    for weights in (contact, others):
        assert np.ptp(weights[weights > 0]) <= 2


@pytest.mark.parametrize("kind", list(KINDS))
def test_adapt_on_more_ranks_than_root_cells(kind):
    """Two root cells: the run starts from a mesh of which every rank has a part, and solves it."""
    scene = pressed(two_boxes(upper=(1, 1, 1)))
    assert len(scene.mesh.cells) == 2
    (step,) = adapt(scene, 0.5, max_steps=1, partition_kind=kind)
    assert step.record.force > 0
    assert (step.record.max_level == 0) == (WORLD.size == 1 or (WORLD.size == 2 and kind == "sfc"))


@pytest.mark.parametrize("kind", list(KINDS))
def test_more_ranks_than_leaves(kind):
    """An error on all ranks that names the kind, and no hang."""
    forest = roots(pressed(two_boxes(upper=(1, 1, 1))))
    if WORLD.size > forest.size_global:
        with pytest.raises(PartitionError, match=f"2 leaves cannot be spread over {WORLD.size} ranks by '{kind}'"):
            repartition(forest, None, kind)
    with pytest.raises(PartitionError, match="2 leaves cannot be spread over 3 parts"):
        assign(roots(pressed(two_boxes(upper=(1, 1, 1))), MPI.COMM_SELF), 3, kind)


@pytest.fixture(scope="module")
def serial_solution():
    """Keys and displacements of the last of a few adaptive steps, computed by each rank for itself."""
    return solution(adapt(split_scene(), 0.05, MPI.COMM_SELF, max_steps=3, solver=Solver(tolerance=1e-9)))


def split_scene():
    """A scene of which the pair-blind curve splits pairs on two ranks and on more."""
    return pressed(two_boxes(upper=(3, 2, 2), depth=2))


def solution(steps):
    """Keys of the conforming vertices, ascending, and their displacements, on all ranks."""
    *_, last = steps
    prolongation = last.elasticity.prolongation
    own = np.flatnonzero((prolongation.conforming >= 0) & (prolongation.conforming < prolongation.owned))
    own = own[np.argsort(prolongation.conforming[own])]
    keys = gathered(last.forest.comm, prolongation.space.keys[own])
    order = np.argsort(keys)
    return keys[order], gathered(last.forest.comm, last.solution.displacement)[order], last.record


@pytest.mark.parametrize("kind", list(KINDS))
def test_same_solution(kind, serial_solution):
    """Every kind gives the serial solution to 1e-8, wherever the pairs are; the solver takes a tenth of that."""
    run = adapt(split_scene(), 0.05, max_steps=3, partition_kind=kind, solver=Solver(tolerance=1e-9))
    keys, displacement, record = solution(run)
    assert record.active_pairs > 20 and record.hanging_nodes > 50
    assert record.partition.kind == kind
    if kind == "sfc" and WORLD.size > 1:
        assert record.partition.split_pairs > 0, "no pair is split"
    everywhere(np.array_equal(keys, serial_solution[0]), "other unknowns")
    error = np.linalg.norm(displacement - serial_solution[1]) / np.linalg.norm(serial_solution[1])
    everywhere(error < 1e-8, f"displacements differ by {error}")
