"""The springs between node pairs: what they cost where normals lie along no axis, and the overlap left by default."""

import pytest

from fx_contact import Enforcement, adapt
from fx_contact.adaptive.beginning import Beginning
from fx_contact.scenes import punch
from studies.stability.shapes import oblique

pytestmark = pytest.mark.whole_run


def iterations(degrees, enforcement):
    """Krylov iterations of one solve of a contact whose normals are turned out of the axes."""
    scene = oblique(degrees)
    options = {"beginning": Beginning.uniform(scene, 1), "max_steps": 1, "enforcement": enforcement}
    record = next(adapt(scene, 0.1, degree=1, **options)).record
    assert record.active_pairs > 20
    return sum(record.krylov_iterations)


@pytest.mark.parametrize("enforcement", [None, Enforcement("penalty", 1e6)], ids=["exact", "stiff penalty"])
def test_oblique_contact_costs_no_more(enforcement):
    """BoomerAMG sees no coupling of directions: pairs that are held have soft springs in the matrix."""
    assert iterations(10, enforcement) <= 1.5 * iterations(0, enforcement)


def test_overlap_by_default():
    """The augmented Lagrangian leaves a millionth of the approach."""
    record = next(adapt(punch(displacement=0.01), 0.5, enforcement=Enforcement("augmented-lagrangian"))).record
    assert record.active_pairs and record.max_penetration < 1e-6 * 0.01
