"""Allowed errors of the forces of contact pairs."""

import pytest

from fx_contact.estimate.contact_goals import force_goals


def test_allowed_errors_by_hand():
    """e times each exact force, or e^2 times the largest one; forces that are not positive are no goals.

    With e = 0.1: of forces 1, 0.2 and 0.01 the errors 0.1, 0.02 and 0.01, a tenth, a tenth and all of the exact ones;
    relative to the computed ones they are a / (1 + a), for these may be too small.
    """
    goals = force_goals(["a", "b", "c", "d", "e"], [1.0, 0.2, 0.01, 0.0, -0.5], 0.1)
    assert {i: goal.tolerance for i, goal in goals.items()} == pytest.approx({0: 1 / 11, 1: 1 / 11, 2: 1 / 2})
    assert [goal.pair for goal in goals.values()] == ["a", "b", "c"]
    assert force_goals(["a"], [0.0], 0.1) == {}
