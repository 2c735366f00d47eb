"""Proposed contact pairs."""

import pytest
from conftest import WORLD

from fx_contact import ContactPair, SceneError, ball, block, contacts_between, root_mesh_from_shapes

pytestmark = pytest.mark.ranks(1, 2)


def stamps(gap):
    """Two stamps, one of them a ball, above a base that has its whole boundary as a surface too."""
    base = block((0, 0, 0), (4, 2, 1), (4, 2, 1), 1).named("all")
    bodies = {"base": base, "one": block((0, 0, 1 + gap), (1, 2, 2 + gap), (2, 2, 1), 1)}
    bodies["two"] = ball(0.5, 3, 1).shifted(x=2.5, y=1.0, z=1.5 + gap)
    return root_mesh_from_shapes(bodies)


def test_surfaces_within_a_distance():
    """Both stamps on the smaller surface of the base, once; none where all is farther away."""
    found = contacts_between(stamps(0.01), within=0.05)
    assert {frozenset(pair.surfaces) for pair in found} == {
        frozenset(("base top", "one bottom")),
        frozenset(("base top", "two outside")),
    }
    assert found[0].surfaces == ("base top", "one bottom") and isinstance(found[0], ContactPair)
    assert WORLD.allgather(found) == [found] * WORLD.size
    assert contacts_between(stamps(0.1), within=0.05) == ()


def test_interference():
    """Bodies that penetrate each other by less than the distance."""
    assert len(contacts_between(stamps(-0.02), within=0.05)) == 2


@pytest.mark.parametrize("within", [0.0, -1.0, float("nan"), "near"])
def test_bad_distance(within):
    with pytest.raises(SceneError, match="the distance of surfaces in contact"):
        contacts_between(stamps(0.0), within)
