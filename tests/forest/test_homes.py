"""Homes of keys: near the leaves, the same for all, and of no consequence but for who talks to whom."""

import time
from dataclasses import replace

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import corner_scene, gathered, grown, leaves, pressed, roots, two_boxes
from mpi4py import MPI

from fx_contact import adapt
from fx_contact.forest.homes import Homes
from fx_contact.forest.partition import Units, along_curve, repartition, with_cuts
from fx_contact.geometry.hexahedron import FACE_CORNERS
from fx_contact.parallel import exchange
from fx_contact.parallel.exchange import Exchange
from fx_contact.parallel.mpi import Directory
from fx_contact.scenes import hertz
from fx_contact.surfaces.facet_pairing import leaf_code

pytestmark = pytest.mark.ranks(1, 2, 3)

SCENES = pytest.mark.parametrize(
    "make", [lambda: pressed(two_boxes(margin=1)), corner_scene, lambda: hertz()], ids=["boxes", "corner", "hertz"]
)


def in_parts(make, parts, pairs=True):
    """A forest on this rank, the part of each leaf along the curve, and homes by the same cuts."""
    forest = grown(roots(make(), MPI.COMM_SELF), 3)
    units = Units(forest, pairs)
    part, cuts = along_curve(units, parts, None)
    return forest, part[units.of_leaf], Homes(forest.mesh, forest.lattice, forest.pairing, cuts, parts)


@SCENES
def test_facing_points_have_one_home(make):
    """Whichever of them is asked for."""
    forest, _, homes = in_parts(make, 40)
    leaf, face = forest.contact_faces()
    points = forest.corners[leaf[:, None], FACE_CORNERS[face]]
    other, _, opposite = forest.pairing.opposite(forest.cell[leaf], face, points)
    here, there = (forest.lattice.keys(*place).ravel() for place in ((forest.cell[leaf], points), (other, opposite)))
    assert (here != there).all() and len(np.unique(homes.of_points(here))) > 3
    assert np.array_equal(homes.of_points(here), homes.of_points(there))


@SCENES
def test_points_inside_leaves_are_at_home(make):
    """So are the leaves, where those that face each other are not one unit; a cut may go through a leaf."""
    forest, part, homes = in_parts(make, 40, pairs=False)
    middle = forest.lattice.keys(forest.cell, forest.corners.mean(axis=1, dtype=int)[:, None].astype(np.int32))
    elsewhere = homes.of_points(middle[:, 0]) - part
    assert np.count_nonzero(elsewhere) < 40 < len(part) / 4 and (np.abs(elsewhere) <= 1).all()
    assert np.array_equal(homes.of_leaves(leaf_code(forest.cell, forest.anchor)), part)


@SCENES
def test_corners_of_leaves_have_homes_nearby(make):
    """The home of a corner is the part of a leaf that has it; a cut may go through such a leaf."""
    forest, part, homes = in_parts(make, 40, pairs=False)
    keys, home = forest.vertices.keys, homes.of_points(forest.vertices.keys)
    inner = np.bincount(forest.vertices.cells.ravel()) == 8  # leaves of one size all around
    having = np.zeros((len(keys), 40), dtype=bool)
    having[forest.vertices.cells, part[:, None]] = True
    assert inner.sum() > 30 and np.count_nonzero(~having[inner, home[inner]]) < min(40, inner.sum() / 4)


def test_the_super_element_of_facing_leaves_is_at_home():
    """Its code has the key of the curve by which it was dealt out."""
    forest, part, homes = in_parts(lambda: pressed(two_boxes(margin=1)), 40)
    assert np.array_equal(homes.of_leaves(forest.representatives), part)


@pytest.mark.parametrize("kind", ["contact-sfc", "equidistributed"])
def test_cuts_go_with_the_forest(kind, monkeypatch):
    """Refined forests have those of the last curve; where there is none, homes are by a hash."""
    monkeypatch.setattr(exchange, "FEW_RANKS", 0)
    forest, _ = repartition(grown(roots(pressed(two_boxes(margin=1))), 3), None, kind)
    finer, _ = forest.refined(forest.level == 1)
    assert finer.cuts is forest.cuts and (forest.cuts is None) == (kind == "equidistributed" or WORLD.size == 1)
    if kind == "contact-sfc" and WORLD.size > 1:
        assert (WORLD.bcast(forest.cuts) == forest.cuts).all()
    keys = forest.vertices.keys
    home = forest.homes.of_points(keys)
    at_home = WORLD.allreduce(int((home == WORLD.rank).sum())) / WORLD.allreduce(len(keys))
    assert at_home > 0.75 if kind == "contact-sfc" or WORLD.size == 1 else at_home < 0.7
    strewn = replace(finer, cuts=None)
    alike = np.array_equal(strewn.homes.of_points(keys), finer.homes.of_points(keys))
    assert alike == (kind == "equidistributed" or WORLD.size == 1)
    assert WORLD.size == 1 or len(with_cuts(strewn).cuts) == WORLD.size - 1


def late_exchanges(monkeypatch):
    """Ranks come to each exchange late, at random."""
    made, late = Exchange.__init__, np.random.default_rng(WORLD.rank)

    def come_late(self, *arguments):
        time.sleep(late.choice([0.0, 0.0, 0.0, 1e-4, 1e-3]))
        made(self, *arguments)

    monkeypatch.setattr(Exchange, "__init__", come_late)


@pytest.mark.parametrize("degree, late", [(1, True), (2, False)])
@pytest.mark.skipif(WORLD.size == 1, reason="no exchange")
def test_nothing_depends_on_who_talks_to_whom(degree, late, monkeypatch):
    """Two steps, all to all by hashed keys, and between partners that may be late: same leaves, numbers and records."""
    found = []
    for ranks in (exchange.FEW_RANKS, 0):
        monkeypatch.setattr(exchange, "FEW_RANKS", ranks)
        if late and ranks == 0:
            late_exchanges(monkeypatch)
        *_, step = adapt(hertz(order=2, coarse=2), 0.3, WORLD, degree=degree, max_steps=2)
        prolongation, record = step.rows.prolongation, step.record
        imap = prolongation.index_map
        number = imap.local_to_global(np.arange(imap.size_local + imap.num_ghosts, dtype=np.int32))
        numbers = prolongation.space.keys, prolongation.conforming, number, step.rows.first, step.rows.entries.node
        found.append((leaves(step.forest), numbers, record))
    (one, numbers, record), (other, others, again) = found
    assert np.array_equal(one, other) and record.step == 1
    everywhere(all(np.array_equal(a, b) for a, b in zip(numbers, others)), "other numbers")
    assert (again.cells, again.dofs, again.active_pairs) == (record.cells, record.dofs, record.active_pairs)
    assert again.partition == record.partition
    assert again.force == pytest.approx(record.force, rel=1e-7)


def test_all_keys_have_homes_by_place(monkeypatch):
    """Every directory of a run has the homes of its forest, none those of a hash."""
    made, found = Directory.__init__, []

    def noted(self, comm, keys, home=None):
        found.append(getattr(home, "__self__", None))
        made(self, comm, keys, home)

    monkeypatch.setattr(Directory, "__init__", noted)
    *_, step = adapt(hertz(order=2, coarse=2), 0.3, WORLD, max_steps=2)
    assert len(found) > 10 and all(isinstance(homes, Homes) for homes in found)
    assert step.forest.vertices.directory.asked(step.forest.vertices.keys).all()


@pytest.mark.skipif(WORLD.size < 3, reason="two ranks are always partners")
def test_partners_are_near(monkeypatch):
    """Along a column of cells a rank at an end has nothing in common with the one at the other end."""
    monkeypatch.setattr(exchange, "FEW_RANKS", 0)
    forest, _ = repartition(grown(roots(pressed(two_boxes(upper=(1, 1, 12), depth=12))), 1), None, "sfc")
    partners = gathered(WORLD, Exchange(WORLD, forest.homes.of_points(forest.vertices.keys)).partners)
    assert WORLD.size <= len(partners) < WORLD.size * (WORLD.size - 1)
