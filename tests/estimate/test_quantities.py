"""Quantities of interest: their estimated errors against known ones, and tolerances of their own."""

import numpy as np
import pytest

from fx_contact import ContactForce, Gap, SceneError, adapt, solve
from fx_contact.adaptive.step_record import StepRecord
from fx_contact.results.reference_values import REFERENCES
from fx_contact.scenes import hertz

pytestmark = pytest.mark.whole_run

POLES = "lower pole on upper pole"


def round_ends():
    return hertz(order=6, coarse=2)


@pytest.mark.slow
def test_effectivity_at_degree_2():
    """The error of the force of Hertz's contact is estimated to a factor of 2, and that of a gap beside it."""
    beside = Gap(POLES, (0.2, 0.0, 0.0), 0.5)
    step = solve(round_ends(), 0.05, goals=(ContactForce(POLES, 0.05), beside))
    finer = solve(round_ends(), 0.01, goals=(beside,)).record.goals[0]
    force, gap = step.record.goals
    assert force.reached and gap.reached and step.record.reached
    assert force.value == step.record.force
    assert 0.5 < force.error / abs(force.value - REFERENCES["hertz-a"]().force) < 2
    assert 0.5 < gap.error / abs(gap.value - finer.value) < 2


def test_a_goal_is_refined_for():
    """With the energy met, the force of a contact pair is held to a tolerance of its own, on 1, 2 and 3 ranks alike."""
    goal = ContactForce(POLES, 0.01)
    *_, before, last = (step.record for step in adapt(hertz(order=3, coarse=2), 0.3, degree=1, goals=(goal,)))
    assert before.estimate < 0.3 and not before.reached and before.goals[0].error > 0.01 * before.force
    assert last.reached and last.goals[0].reached and last.goals[0].error <= 0.01 * last.force
    assert StepRecord.from_json(last.as_json()).goals == last.goals


def test_no_goals_no_record():
    assert solve(hertz(order=2, coarse=2), 0.6, degree=1).record.goals is None


@pytest.mark.parametrize(
    "goals, words",
    [
        ((ContactForce("lower pole", 0.1),), "unknown contact pair 'lower pole'"),
        (ContactForce(POLES, 0.1), "must be a tuple"),
        (("force",), "must be a ContactForce or a Gap"),
    ],
)
def test_bad_goals(goals, words):
    with pytest.raises(SceneError, match=words):
        adapt(hertz(order=2, coarse=2), 0.5, goals=goals)


def test_bad_tolerance():
    for make in (lambda: ContactForce(POLES, -1.0), lambda: Gap(POLES, (0, 0, 0), np.nan)):
        with pytest.raises(SceneError, match="must be a positive number"):
            make()
