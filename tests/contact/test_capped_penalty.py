"""The capped penalty in the preconditioner matrix: iterations where normals lie along no axis."""

import pytest

from fx_contact import Enforcement, adapt
from fx_contact.adaptive.beginning import Beginning
from studies.stability.shapes import oblique


def iterations(degrees, enforcement):
    """Krylov iterations of one solve of a contact whose normals are turned out of the axes."""
    scene = oblique(degrees)
    options = {"beginning": Beginning.uniform(scene, 1), "max_steps": 1, "enforcement": enforcement}
    record = next(adapt(scene, 0.1, degree=1, **options)).record
    assert record.active_pairs > 20
    return sum(record.krylov_iterations)


@pytest.mark.parametrize("enforcement", [None, Enforcement("penalty", 1e6)], ids=["exact", "stiff penalty"])
def test_oblique_contact_costs_no_more(enforcement):
    """BoomerAMG sees no coupling of directions: the penalty of projected rows is capped in the matrix."""
    assert iterations(10, enforcement) <= 1.5 * iterations(0, enforcement)
