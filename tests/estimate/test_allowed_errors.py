"""Allowed errors of the forces of contact pairs."""

import numpy as np

from fx_contact.estimate.contact_goals import force_goals


def test_allowed_errors_by_hand():
    """Errors e of each force, or e^2 of the largest, of the exact one.

    With e = 0.1: of forces 1, 0.2 and 0.01 the errors 0.1, 0.02 and 0.01, a tenth, a tenth and all of the exact force;
    relative to a computed force, which may be too small, they are a / (1 + a).
    """
    goals = force_goals("abcd", [1.0, 0.2, 0.01, 0.0], 0.1)
    assert [goal.pair for goal in goals.values()] == ["a", "b", "c"] and [*goals] == [0, 1, 2]
    assert np.allclose([goal.tolerance for goal in goals.values()], [1 / 11, 1 / 11, 1 / 2], rtol=1e-14)
    assert not force_goals("a", [0.0], 0.1)
