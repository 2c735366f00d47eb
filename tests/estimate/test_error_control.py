"""What a run refines for and when it stops: marking, effectivity, and the two modes of control."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import gathered, leaves, roots, strewn
from mpi4py import MPI

from fx_contact import ErrorControl, Material, adapt
from fx_contact.adaptive.checkpoint import Checkpoint
from fx_contact.estimate.effectivity import RefinementHistory
from fx_contact.estimate.estimator import Estimate
from fx_contact.estimate.marking import for_tolerance
from fx_contact.geometry.lattice import SIDE
from fx_contact.parallel.errors import CheckpointError
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


def check_loss(estimate, marked, lost):
    """What refinement is said to lose of xi^2 is what it loses."""
    total2 = estimate.error_global**2
    assert abs(left(estimate, marked) ** 2 - (total2 - lost)) < 1e-9 * total2


def test_marking_stops_where_the_tolerance_is_met():
    """Enough cells for the tolerance and hardly more."""
    errors = np.geomspace(1e-4, 1e-2, 3000)
    total = np.sqrt((errors**2).sum())
    for share in (0.95, 0.8):
        mine = spread(errors)
        marked, lost = for_tolerance(mine, share * total, None, CONTACT.target, WORLD)
        assert 0.85 * share * total < left(mine, marked) <= 0.9 * share * total
        check_loss(mine, marked, lost)
        everywhere(least_marked(mine, marked) > mine.error[marked == 0].max(), "not the largest are marked")


@pytest.mark.parametrize("child", [1 / 32, 1 / 128])
def test_a_step_that_cannot_suffice_refines_for_the_meshes_to_come(child):
    """The threshold is that of a mesh that meets the tolerance, between whose cells and their children errors lie."""
    errors = np.geomspace(1e-5, 1e-1, 3000)
    tolerance = 1e-3 * np.sqrt((errors**2).sum())
    final = np.sqrt(child) ** np.linspace(0, 1, 1001)  # errors of the cells of such a mesh, over the threshold
    threshold = tolerance / np.sqrt(len(errors)) / np.sqrt(np.mean(final**2))
    mine = spread(errors, child_error=child)
    marked, _ = for_tolerance(mine, tolerance, 0.5, CONTACT.target, WORLD)
    least, most = least_marked(mine, marked), mine.error[marked == 0].max(initial=0)
    assert 0.99 * threshold < least < 1.01 * threshold and WORLD.allreduce(int(marked.max()), op=MPI.MAX) == 2
    everywhere(most <= least, "not the largest are marked")
    above = np.arange(3000) % 2 == 0  # of errors at 3 and 1.5 times (2): once only
    two = spread(np.where(above, 3.0, 1.5) * tolerance / np.sqrt(3000), child_error=child)
    marked, _ = for_tolerance(two, tolerance, 0.1, CONTACT.target, WORLD)
    everywhere(np.array_equal(marked, dealt(above)), "not those above the threshold")
    even = spread(np.full(3000, 1.5 * tolerance / np.sqrt(3000)), child_error=child)  # all below that threshold
    everywhere((for_tolerance(even, tolerance, 0.1, CONTACT.target, WORLD)[0] == 1).all(), "no cell of criterion (2)")


def test_one_step_of_degree_2_aims_at_a_quarter():
    """However small the tolerance is; a larger aim than a quarter is met.  At degree 1 there is no such aim."""
    errors = np.geomspace(1e-4, 1e-2, 3000)
    total = np.sqrt((errors**2).sum())
    mine = spread(errors, child_error=1 / 128)
    for share, aim in ((1e-3, 0.25), (0.1, 0.25), (0.6, 0.54)):
        marked, _ = for_tolerance(mine, share * total, 1.0, CONTACT.target, WORLD)
        assert 0.98 * aim * total < left(mine, marked) <= aim * total
    linear, tolerance = spread(errors, child_error=1 / 32), 0.5 * total  # of which (2) would leave 0.99
    marked, _ = for_tolerance(linear, tolerance, 1.0, CONTACT.target, WORLD)
    ratio = least_marked(linear, marked) / (tolerance / np.sqrt(linear.cells))
    assert 1.85 < ratio < 1.95, "not for the meshes to come"


def test_a_lower_threshold_saves_a_solve():
    """Where the threshold of the meshes to come misses the tolerance, one down to criterion (2) may meet it."""
    errors = np.geomspace(1e-3, 1e-2, 3000)
    total = np.sqrt((errors**2).sum())
    mine, tolerance = spread(errors), 0.65 * total
    for rate in (None, 1.0):
        marked, lost = for_tolerance(mine, tolerance, rate, CONTACT.target, WORLD)
        assert 0.85 * tolerance < left(mine, marked) <= 0.9 * tolerance
        check_loss(mine, marked, lost)
        assert 1 < least_marked(mine, marked) / (tolerance / np.sqrt(mine.cells)) < 1.5


def test_marking_uses_the_loss_of_the_last_refinement():
    """After a step that brought half of what a smooth solution would give, more cells are marked."""
    errors = np.geomspace(1e-4, 1e-2, 3000)
    total = np.sqrt((errors**2).sum())
    counts = []
    for brought in (1.0, 0.5):
        before = spread(errors)
        marked, history = CONTACT.marked(before, 0.5 * total, CONTACT.begin(1, 0.3), WORLD)
        now = np.sqrt(total**2 - brought * (total**2 - left(before, marked) ** 2))
        after, _ = CONTACT.marked(spread(errors * now / total), 0.9 * now, history, WORLD)
        counts.append(WORLD.allreduce(int(after.sum())))
    assert counts[1] > 1.5 * counts[0]


@pytest.mark.parametrize("theta", [0.3, 0.5, 0.8, 1.0, 1.3])
def test_effectivity_is_measured_by_refinement(theta):
    """If the error halves with each mesh its effectivity is found within two meshes."""
    true, history = 0.5 ** np.arange(4), CONTACT.begin(1, 0.3)
    estimates = [spread(np.full(8, theta * error / np.sqrt(8))) for error in true]
    for before, after, last, now in zip(estimates, estimates[1:], true, true[1:]):
        _, history = CONTACT.marked(before, 0.1, history, WORLD)
        history = history.observed(after, np.sqrt(last**2 - now**2), CONTACT.least_effectivity)
    assert abs(history.effectivity - min(max(theta, 0.4), 1.0)) < 0.02 and history.compared
    same_mesh = replace(history, refined=False)
    assert same_mesh.observed(spread(np.ones(8)), 1e9, 0.4) == same_mesh


def test_tolerance_is_corrected_by_a_low_effectivity():
    """Down to 0.8 an estimate is taken at its word; below, it is divided by its effectivity."""
    error = spread(np.full(8, 0.1 / np.sqrt(8)))
    taken = (1.0, 0.1001, None), (0.8, 0.1001, None), (0.79, 0.13, None), (0.4, 0.251, None)
    for theta, tolerance, sought in (*taken, (0.79, 0.12, 0.0948), (0.4, 0.2, 0.08)):
        found = CONTACT.sought(error, tolerance, RefinementHistory(theta, compared=True))
        assert found is sought or abs(found - sought) < 1e-12
    for history in (RefinementHistory(0.4, compared=True), CONTACT.begin(1, 0.3)):
        assert CONTACT.sought(error, 0.05, history) == 0.05


def test_a_first_mesh_may_be_enough():
    """At degree 2 the least effectivity is assumed on a first mesh: xi / 0.4 has to meet the tolerance."""
    error, begin = spread(np.geomspace(1e-4, 1e-3, 8)), CONTACT.begin(2, 0.3)
    assert CONTACT.effectivity(begin) == 0.4
    for share, met in ((0.399, True), (0.401, False), (1e-9, True)):
        tolerance = error.relative / share
        sought = CONTACT.sought(error, tolerance, begin)
        assert (sought is None) == met and (met or abs(sought - 0.4 * tolerance) < 1e-12)
    marked, history = CONTACT.marked(error, error.relative / 0.3, begin, WORLD)
    everywhere((marked == 0).all() and history.refined, "goals alone are refined for")
    marked, _ = CONTACT.marked(error, error.relative / 0.5, begin, WORLD)
    assert 0 < WORLD.allreduce(int((marked > 0).sum())) < 8, "not by threshold"
    assert CONTACT.sought(spread(np.zeros(8)), 0.1, begin) is None


@pytest.mark.parametrize("data", [(1, 0.3), (2, 0.4), (2, 0.3, True)], ids=["degree 1", "rubber", "functions"])
def test_a_first_mesh_is_refined_to_see(data):
    """Where an estimate that meets the tolerance on a first mesh shows nothing, all of it is refined, once."""
    error, begin = spread(np.geomspace(1e-4, 1e-3, 8)), CONTACT.begin(*data)
    assert CONTACT.sought(error, 0.5, begin) is not None
    marked, history = CONTACT.marked(error, 0.5, begin, WORLD)
    everywhere((marked == 1).all(), "not uniformly")
    history = history.observed(error, 0.0, CONTACT.least_effectivity)
    assert history.compared and CONTACT.sought(error, 0.5, history) is None
    marked, _ = CONTACT.marked(error, error.relative / 2, begin, WORLD)
    assert 0 < WORLD.allreduce(int((marked > 0).sum())) < 8, "not by criterion (2)"


def test_both_modes_by_hand():
    """Four cells, xi_T = 1, 2, 3, 4 J^(1/2), omega = 10 J^(1/2): xi = 30^(1/2), relative 0.548.

    For e = 0.5 criterion (2) is xi_T > 0.5 * 10 / 4^(1/2) = 2.5: the cells 3 and 4, once each.  (6) is met from
    e = 0.548 on.  "contact" aims at 0.9 e: xi^2 has to fall from 30 to (4.5)^2 = 20.25.  Refining a cell once leaves a
    quarter of its xi_T^2: 16 falls to 4, so that 18 are left, and the cell 4 is enough.
    """
    error = spread(np.array([1.0, 2.0, 3.0, 4.0]), energy=10.0)
    begin = ENERGY.begin(1, 0.3)
    assert ENERGY.sought(error, 0.5, begin) == 0.5 and ENERGY.sought(error, 0.547, begin) == 0.547
    assert ENERGY.sought(error, 0.548, begin) is None  # on the first mesh, with no effectivity
    for known in (begin, RefinementHistory(0.4, 60.0, 10.0, True, True)):
        times, after = ENERGY.marked(error, 0.5, known, WORLD)
        assert np.array_equal(times, dealt(np.array([0, 0, 1, 1]))) and after == known
        assert np.array_equal(ENERGY.marked(error, 0.1, known, WORLD)[0], dealt(np.ones(4)))  # never twice
    times, _ = ENERGY.marked(error, 0.4, begin, WORLD)
    assert np.array_equal(times, dealt(np.array([0, 0, 1, 1])))  # 2 is not above 2
    assert ENERGY.effectivity(RefinementHistory(0.4)) == ENERGY.correction(RefinementHistory(0.4)) == 1.0

    times, after = CONTACT.marked(error, 0.5, CONTACT.begin(1, 0.3), WORLD)
    assert np.array_equal(times, dealt(np.array([0, 0, 0, 1])))
    assert np.allclose([after.error2, after.expected_loss], [30, 12], rtol=1e-14)
    assert after == replace(
        CONTACT.begin(1, 0.3), error2=after.error2, expected_loss=after.expected_loss, refined=True
    )
    # A finer mesh with xi^2 = 18 and a change of 6^(1/2): theta_0 = (30 / (6 + 18 / 0.4^2))^(1/2) and once more.
    finer = spread(np.sqrt(np.full(4, 4.5)), energy=10.0)
    theta = np.sqrt(30 / (6 + 18 / (30 / (6 + 18 / 0.16))))
    history = after.observed(finer, np.sqrt(6.0), CONTACT.least_effectivity)
    assert abs(history.effectivity - theta) < 1e-12 and 0.5 < theta < 0.8
    assert CONTACT.sought(finer, 0.45, history) == CONTACT.correction(history) * 0.45  # xi / omega = 0.424
    assert CONTACT.sought(finer, 0.43 / theta, history) is None
    assert CONTACT.sought(finer, 0.5, CONTACT.begin(1, 0.3)) == 0.2  # nothing is measured on a first mesh


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
    times, _ = control.marked(estimate, 0.5, control.begin(1, 0.3), WORLD)
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
    assert not first.record.reached and last.record.reached and last.record.assumed_effectivity > 0.4
    assert last.record.dofs < 4 * first.record.dofs, "refined as a whole"


def test_a_run_goes_on_with_its_own_control(tmp_path):
    """Checkpoints remember the control: another one is refused, the same goes on to the same mesh."""
    folder, scene = WORLD.bcast(tmp_path), indentation(coarse=2)
    through = list(adapt(scene, 0.2, control=ENERGY, max_steps=3))
    list(adapt(scene, 0.2, control=ENERGY, max_steps=2, checkpoint=folder))
    with pytest.raises(CheckpointError, match="error control"):
        adapt(scene, 0.2, restart=Checkpoint(folder, scene, WORLD))
    same = ErrorControl("energy", target=0.8)  # which this mode does not use
    (again,) = adapt(scene, 0.2, control=same, max_steps=3, restart=Checkpoint(folder, scene, WORLD))
    assert np.array_equal(leaves(again.forest), leaves(through[-1].forest))


def test_reports():
    """A control shows the parameters that it uses."""
    assert repr(ENERGY) == "ErrorControl(mode='energy')"
    assert repr(CONTACT).startswith("ErrorControl(mode='contact', target=0.9, ") and eval(repr(CONTACT)) == CONTACT
