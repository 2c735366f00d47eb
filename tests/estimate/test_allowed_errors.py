"""Tolerances of the forces of contact pairs."""

from math import isclose

from fx_contact.estimate.contact_goals import force_goals


def test_tolerances_by_hand():
    """A force may be off by e, or by e^2 of the largest, of what it should be; pairs that do not press have no goal.

    With e = 0.1: of forces 1, 0.2 and 0.01 the errors 0.1, 0.02 and 0.01, a tenth, a tenth and all of what they should
    be; relative to what they are a / (1 + a), for they may be too small.
    """
    goals = force_goals(["a", "b", "c", "d", "e"], [1.0, 0.2, 0.01, -0.01, 0.0], 0.1)
    assert [goals[index].pair for index in goals] == ["a", "b", "c"]
    for index, share in enumerate((1 / 11, 1 / 11, 1 / 2)):
        assert isclose(goals[index].tolerance, share, rel_tol=1e-14)
