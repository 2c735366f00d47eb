"""Contact patches are what is connected, on any number of ranks."""

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import DISTRIBUTIONS, grown, pressed, roots, two_boxes

from fx_contact import Enforcement
from fx_contact.contact.contact_patches import ContactPatches
from fx_contact.contact.node_pairs import create_node_pairs
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space


@pytest.mark.parametrize("distribution", list(DISTRIBUTIONS))
def test_stripes(distribution):
    """Closed stripes across a surface are patches of their own where open pairs are between them, and one if not."""
    scene = pressed(two_boxes(upper=(6, 2, 1), distortion=0.0))
    forest = DISTRIBUTIONS[distribution](grown(roots(scene), 3, share=0.3))
    prolongation = Prolongation(Space(forest, 1))
    assert prolongation.hanging_global > 0
    pairs = create_node_pairs(scene, forest, prolongation, Enforcement())
    x = pairs.position[:, 0]
    for low, number in ((2.0, 2), (4.8, 1)):  # facets have sides of 1 to 1/8
        active = (x < low) | (x > 4.9)
        patches = ContactPatches(forest, pairs, active)
        assert patches.number == number
        everywhere((patches.pair[active] >= 0).all(), "a closed pair in no patch")
        left, right = (set(patches.pair[active & side].tolist()) for side in (x < 3, x > 3))
        left, right = (set().union(*WORLD.allgather(some)) for some in (left, right))
        assert len(left) == len(right) == 1 and len(left | right) == number
    assert ContactPatches(forest, pairs, np.zeros(len(pairs), dtype=bool)).number == 0


@pytest.mark.parametrize("distribution", list(DISTRIBUTIONS))
def test_one_closed_vertex(distribution):
    """Facets that are closed at one of their vertices are a patch, and so are those next to them."""
    scene = pressed(two_boxes(upper=(6, 2, 1), distortion=0.0))
    forest = DISTRIBUTIONS[distribution](roots(scene))
    pairs = create_node_pairs(scene, forest, Prolongation(Space(forest, 1)), Enforcement())
    patches = ContactPatches(forest, pairs, np.abs(pairs.position - [1.0, 1.0, 0.0]).max(axis=1) < 1e-9)
    assert patches.number == 1
    # Four facets around it, and the two beyond x = 2: the surface ends on the other sides.
    assert WORLD.allreduce(int((patches.facet[0] >= 0).sum())) == 6
    assert WORLD.allreduce(int((patches.pair >= 0).sum())) == 9
