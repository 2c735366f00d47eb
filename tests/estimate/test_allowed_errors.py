"""How wrong the forces of contact pairs may be."""

import numpy as np

from fx_contact.estimate.contact_goals import allowed_errors


def test_allowed_errors_by_hand():
    """e of each force, or e^2 of the largest, of what it should be; the estimate sees a part of the error alone.

    With e = 0.1: of forces 1, 0.2 and 0.01 the errors 0.1, 0.02 and 0.01, a tenth, a tenth and all of what they should
    be; relative to what they are a / (1 + a), for they may be too small.
    """
    for seen in (1.0, 0.5):
        found = allowed_errors([1.0, 0.2, -0.01, 0.0], 0.1, seen)
        assert np.allclose(found, seen * np.array([1 / 11, 1 / 11, 1 / 2, 1.0]), rtol=1e-14)
    assert np.allclose(allowed_errors([0.0], 0.1, 1.0), 1.0)
