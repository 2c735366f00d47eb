"""How a gap is shared by the two bodies that close it."""

import numpy as np
from conftest import WORLD, everywhere
from model_problems import discrete, grown, pressed, roots, two_boxes

from fx_contact import Enforcement, Material
from fx_contact.contact.jump import Jump
from fx_contact.contact.projection import Projection
from fx_contact.contact.row_kinds import create_rows
from fx_contact.fem.dirichlet import find_supports


def test_the_softer_body_follows_the_stiffer():
    """Vertices of a pair close its gap in inverse proportion to their moduli, along the normal."""
    materials = Material(4.0, 0.3), Material(1.0, 0.3)
    scene = pressed(two_boxes(), materials=materials)
    forest = grown(roots(scene), 2, share=0.2)
    prolongation = discrete(scene, forest).prolongation
    pairs = create_rows(scene, prolongation, Enforcement())
    jump = Jump(pairs, find_supports(scene, forest, prolongation))
    projection = Projection(jump.with_gap(np.full(len(pairs), 0.05)))
    projection.close(np.ones(len(pairs), dtype=bool))
    u = prolongation.ghosted(projection.onto_closed(np.zeros((prolongation.owned, 3))))
    assert WORLD.allreduce(len(pairs)) > 9
    everywhere(np.allclose(u[pairs.first], [0.0, 0.0, 0.01], atol=1e-15), "the stiffer one goes another way")
    everywhere(
        np.allclose(u[pairs.entries.node[1::2]], [0.0, 0.0, -0.04], atol=1e-15), "the softer one goes another way"
    )
