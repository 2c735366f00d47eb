"""What a run refines for and when it stops: marking, effectivity, and the two modes of control."""

from itertools import product

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import gathered, leaves, roots, strewn
from mpi4py import MPI

from fx_contact import ErrorControl, Material, adapt
from fx_contact.estimate.estimator import Estimate
from fx_contact.estimate.marking import expected_estimate, for_tolerance
from fx_contact.geometry.lattice import SIDE
from fx_contact.scenes import indentation, stack

CONTACT, ENERGY = ErrorControl(), ErrorControl("energy")
HALF = SIDE // 2


def spread(errors, energy=1.0, child_error=1 / 32):
    """An Estimate of cell errors dealt out to the ranks."""
    total = float(np.sqrt((errors**2).sum()))
    return Estimate(dealt(errors), None, total, energy, len(errors), child_error)


def dealt(values):
    """This rank's part of an array."""
    return values[WORLD.rank :: WORLD.size]


def left(estimate, marked):
    """xi after refinement of a smooth solution, of which eight children have 8 c of the square of a cell's error."""
    return np.sqrt(WORLD.allreduce(float((estimate.error**2 * (8 * estimate.child_error) ** marked).sum())))


def least_marked(estimate, marked):
    """The least error of the cells that are marked."""
    return WORLD.allreduce(float(estimate.error[marked > 0].min(initial=np.inf)), op=MPI.MIN)


def test_marking_stops_where_the_tolerance_is_met():
    """Enough cells for the tolerance and hardly more."""
    errors = np.geomspace(1e-4, 1e-2, 3000)
    total = np.sqrt((errors**2).sum())
    for share in (0.95, 0.8):
        mine = spread(errors)
        marked = for_tolerance(mine, share * total, CONTACT.target, WORLD)
        assert 0.85 * share * total < left(mine, marked) <= 0.9 * share * total
        everywhere(least_marked(mine, marked) > mine.error[marked == 0].max(), "not the largest are marked")


def test_a_step_that_cannot_suffice_refines_for_the_meshes_to_come():
    """The threshold is that of a mesh that meets the tolerance, between whose cells and their children errors lie."""
    errors = np.geomspace(1e-5, 1e-1, 3000)
    tolerance = 1e-3 * np.sqrt((errors**2).sum())
    final = np.sqrt(1 / 32) ** np.linspace(0, 1, 1001)  # errors of the cells of such a mesh, over the threshold
    threshold = tolerance / np.sqrt(len(errors)) / np.sqrt(np.mean(final**2))
    mine = spread(errors)
    marked = for_tolerance(mine, tolerance, CONTACT.target, WORLD)
    least, most = least_marked(mine, marked), mine.error[marked == 0].max(initial=0)
    assert 0.99 * threshold < least < 1.01 * threshold and WORLD.allreduce(int(marked.max()), op=MPI.MAX) == 2
    everywhere(most <= least, "not the largest are marked")


@pytest.mark.parametrize("child", [1 / 32, 1 / 128])
def test_cells_of_the_criterion_that_cannot_suffice(child):
    """Most cells are just below (2), and keep most of the allowed error: those at 3 times (2) are refined once."""
    place = np.arange(3000) % 20
    for above, expected in ((3.0, place == 0), (1.5, place < 2)):  # of 1.5 alone none is above the threshold
        errors = np.select([place == 0, place == 1], [above, 1.5], 0.97)
        marked = for_tolerance(spread(errors / np.sqrt(3000), child_error=child), 1.0, CONTACT.target, WORLD)
        everywhere(np.array_equal(marked, dealt(expected)), "not those above the threshold")


def test_one_step_of_degree_2_aims_at_a_quarter():
    """However small the tolerance is; a larger aim than a quarter is met.  At degree 1 there is no such aim."""
    errors = np.geomspace(1e-4, 1e-2, 3000)
    total = np.sqrt((errors**2).sum())
    mine = spread(errors, child_error=1 / 128)
    for share, aim in ((1e-3, 0.25), (0.1, 0.25), (0.6, 0.54)):
        marked = for_tolerance(mine, share * total, CONTACT.target, WORLD)
        assert 0.98 * aim * total < left(mine, marked) <= aim * total
    linear, tolerance = spread(errors, child_error=1 / 32), 0.5 * total  # of which (2) would leave 0.99
    marked = for_tolerance(linear, tolerance, CONTACT.target, WORLD)
    ratio = least_marked(linear, marked) / (tolerance / np.sqrt(linear.cells))
    assert 1.85 < ratio < 1.95, "not for the meshes to come"


def test_a_measured_loss_predicts_the_next():
    """Where half of the loss came that a smooth solution has, cells with twice the errors are refined."""
    errors = np.geomspace(1e-4, 1e-2, 3000)
    total = np.sqrt((errors**2).sum())
    mine, aim = spread(errors, child_error=1 / 128), 0.9 * total
    found = [for_tolerance(mine, aim, CONTACT.target, WORLD, rate) for rate in (1.0, 0.5)]
    lost = [total**2 - left(mine, marked) ** 2 for marked in found]
    need = total**2 - (0.9 * aim) ** 2
    assert need <= lost[0] < 1.02 * need and 2 * need <= lost[1] < 2.04 * need
    for marked in found:
        expected = expected_estimate(mine, marked, WORLD)
        assert expected == pytest.approx(left(mine, marked) / mine.energy_norm, rel=1e-12)


def test_runs_pass_on_the_measured_loss(monkeypatch):
    """By the last two records, from the second refinement on."""
    rates, marked = [], ErrorControl.marked

    def spy(self, *args):
        rates.append(args[-1])
        return marked(self, *args)

    monkeypatch.setattr(ErrorControl, "marked", spy)
    first, second, third = (step.record for step in adapt(indentation(coarse=2), 0.05, degree=1, max_steps=3))
    lost = [first.estimate**2 - xi**2 for xi in (second.estimate, second.expected_estimate)]
    assert first.expected_estimate is None and third.expected_estimate < second.estimate
    assert rates == [1.0, pytest.approx(lost[0] / lost[1], rel=1e-12)] and 0.3 < rates[1] < 0.9


def test_a_lower_threshold_saves_a_solve():
    """Where the threshold of the meshes to come misses the tolerance, one down to criterion (2) may meet it."""
    errors = np.geomspace(1e-3, 1e-2, 3000)
    total = np.sqrt((errors**2).sum())
    mine, tolerance = spread(errors), 0.65 * total
    marked = for_tolerance(mine, tolerance, CONTACT.target, WORLD)
    assert 0.85 * tolerance < left(mine, marked) <= 0.9 * tolerance
    assert 1 < least_marked(mine, marked) / (tolerance / np.sqrt(mine.cells)) < 1.5


def test_a_first_mesh_may_be_enough():
    """At degree 2 the least effectivity is assumed on a first mesh: xi / 0.4 has to meet the tolerance."""
    error = spread(np.geomspace(1e-4, 1e-3, 8), child_error=1 / 128)
    assert CONTACT.effectivity(2) == 0.4
    for share, met in ((0.399, True), (0.401, False), (1e-9, True)):
        tolerance = error.relative / share
        sought = CONTACT.sought(error, tolerance, 0.4)
        assert (sought is None) == met and (met or abs(sought - 0.4 * tolerance) < 1e-12)
        assert CONTACT.sought(error, tolerance, 1.0) is None, "a later mesh"
    everywhere((CONTACT.marked(error, error.relative / 0.3, 0.4, WORLD) == 0).all(), "goals alone are refined for")
    marked = CONTACT.marked(error, error.relative / 0.5, 0.4, WORLD)
    assert 0 < WORLD.allreduce(int((marked > 0).sum())) < 8, "not by threshold"
    assert CONTACT.sought(spread(np.zeros(8), child_error=1 / 128), 0.1, 0.4) is None


@pytest.mark.parametrize("degree, expected", [(1, (0.4, 0.7, 0.85, 1.0, 1.0)), (2, (0.4, 0.85, 1.0, 1.0, 1.0))])
def test_effectivity_of_later_meshes(degree, expected):
    """1 - theta falls as h^p, to at most 0.1; refinement aims at the tolerance of the next mesh."""
    found = [CONTACT.effectivity(degree)]
    while len(found) < len(expected):
        found.append(CONTACT.effectivity(degree, found[-1]))
    assert found == pytest.approx(list(expected), rel=1e-12)
    error = spread(np.geomspace(1e-4, 1e-3, 8))
    tolerance = error.relative / 1.2
    twice = [CONTACT.marked(error, tolerance, 1.0, WORLD, later) for later in (1.0, 0.5)]
    everywhere(np.array_equal(twice[1], CONTACT.marked(error, 0.5 * tolerance, 1.0, WORLD)), "another aim")
    assert WORLD.allreduce(int(twice[0].sum())) < WORLD.allreduce(int(twice[1].sum()))


def test_at_degree_1_a_first_mesh_is_refined():
    """Also if its estimate, which may be 0 on one layer of cells, meets the tolerance: all of it, once."""
    error = spread(np.geomspace(1e-4, 1e-3, 8))
    for estimate in (error, spread(np.zeros(8))):
        assert CONTACT.sought(estimate, 0.5, 0.4) is not None and CONTACT.sought(estimate, 0.5, 1.0) is None
        everywhere((CONTACT.marked(estimate, 0.5, 0.4, WORLD) == 1).all(), "not uniformly")
    marked = CONTACT.marked(error, error.relative / 2, 0.4, WORLD)
    assert 0 < WORLD.allreduce(int((marked > 0).sum())) < 8, "not by criterion (2)"


def test_both_modes_by_hand():
    """Four cells, xi_T = 1, 2, 3, 4 J^(1/2), omega = 10 J^(1/2): xi = 30^(1/2), relative 0.548.

    For e = 0.5 criterion (2) is xi_T > 0.5 * 10 / 4^(1/2) = 2.5: the cells 3 and 4, once each.  (6) is met from
    e = 0.548 on.  "contact" aims at 0.9 e: xi^2 has to fall from 30 to (4.5)^2 = 20.25.  Refining a cell once leaves a
    quarter of its xi_T^2: 16 falls to 4, so that 18 are left, and the cell 4 is enough.
    """
    error = spread(np.array([1.0, 2.0, 3.0, 4.0]), energy=10.0)
    assert ENERGY.sought(error, 0.5, 1.0) == 0.5 and ENERGY.sought(error, 0.547, 1.0) == 0.547
    assert ENERGY.effectivity(1) == 1.0 and ENERGY.sought(error, 0.548, 1.0) is None
    assert np.array_equal(ENERGY.marked(error, 0.5, 1.0, WORLD), dealt(np.array([0, 0, 1, 1])))
    assert np.array_equal(ENERGY.marked(error, 0.1, 1.0, WORLD), dealt(np.ones(4)))  # never twice
    assert np.array_equal(ENERGY.marked(error, 0.4, 1.0, WORLD), dealt(np.array([0, 0, 1, 1])))  # 2 is not above 2
    for theta in (0.4, 1.0):
        assert np.array_equal(CONTACT.marked(error, 0.5, theta, WORLD), dealt(np.array([0, 0, 0, 1])))


@pytest.mark.parametrize("control", [ENERGY, CONTACT], ids=["energy", "contact"])
@pytest.mark.parametrize(
    "marked, partner",
    [((0, (HALF, 0, HALF)), (1, (HALF, 0, 0))), ((1, (0, HALF, 0)), (0, (0, HALF, HALF))), ((0, (HALF, 0, 0)), None)],
)
def test_partners_by_hand(control, marked, partner):
    """Two root cells, one on the other, refined once: 16 leaves (root cell, anchor), eight of them in contact.

    One has xi_T = 4 J^(1/2), the others 1, omega = 10 J^(1/2), e = 0.5.  Criterion (2) is xi_T > 0.5 * 10 / 16^(1/2),
    and "contact" has to bring xi^2 = 31 down to 20.25: refined once, the one leaves 19.  It is refined, and with it (5)
    the leaf that it faces, if it faces one.
    """
    start = roots(stack([Material(1.0, 0.3)] * 2, cells=(1, 1, 1)))
    forest = strewn(start.refined(np.ones(len(start), dtype=bool))[0])
    assert forest.size_global == 16
    mine = (forest.cell == marked[0]) & (forest.anchor == marked[1]).all(axis=1)
    estimate = Estimate(np.where(mine, 4.0, 1.0), None, np.sqrt(31.0), 10.0, 16, 1 / 32)
    times = control.marked(estimate, 0.5, control.effectivity(1), WORLD)
    fine, _ = forest.refined_with(times)
    places, quarters = set(product((0, 1), product((0, HALF), repeat=3))), product((0, HALF // 2), repeat=3)
    children = product({marked, partner} - {None}, quarters)
    expected = [[cell, 1, *anchor] for cell, anchor in places - {marked, partner}]
    expected += [[cell, 2, *np.add(anchor, quarter).tolist()] for (cell, anchor), quarter in children]
    found = gathered(WORLD, np.column_stack([fine.cell, fine.level, fine.anchor])).tolist()
    assert sorted(found) == sorted(expected) and len(found) == (30 if partner else 23)


def test_a_run_of_the_mode_energy():
    """Marking (2), stop (6), and that a step refines what is marked: a whole run, from its own indicators.

    Contact has no goals.
    """
    tolerance, steps = 0.1, list(adapt(indentation(coarse=2), 0.1, control=ENERGY))
    assert len(steps) > 2
    for step, finer in zip(steps, steps[1:]):
        record, error, forest = step.record, step.estimate, step.forest
        assert not record.reached and record.ratio > 1
        above = error.error > tolerance * error.energy_norm / np.sqrt(record.cells)
        marked = np.zeros(len(forest), dtype=bool)
        marked[step.leaf_mesh.leaf] = above
        assert np.array_equal(leaves(finer.forest), leaves(forest.refined(marked)[0]))
    last = steps[-1].record
    assert last.reached and last.ratio <= 1 and last.control == "energy"
    assert last.assumed_effectivity == 1 and last.pair_errors == [None] and last.penetrated_leaves is None


def test_the_mode_energy_may_stop_on_the_first_mesh():
    """(6) needs one mesh; so does the default at degree 2 where the least effectivity suffices, at degree 1 two."""
    scene = indentation(coarse=2)
    (only,) = adapt(scene, 0.9, control=ENERGY, degree=1)
    first, *_, last = adapt(scene, 0.9, degree=1)
    assert only.record.reached and not first.record.reached and last.record.reached
    (only,) = adapt(scene, 0.9)
    assert only.record.reached and only.record.assumed_effectivity == 0.4 and only.record.ratio < 0.4
    first, *_, last = adapt(scene, 2 * only.record.estimate)
    assert not first.record.reached and last.record.reached and last.record.assumed_effectivity == 0.85
    assert last.record.dofs < 4 * first.record.dofs, "refined as a whole"


def test_reports():
    """A control shows the parameters that it uses."""
    assert repr(ENERGY) == "ErrorControl(mode='energy')"
    assert repr(CONTACT).startswith("ErrorControl(mode='contact', target=0.9, ") and eval(repr(CONTACT)) == CONTACT
