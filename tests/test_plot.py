"""The section that the stress picture shows."""

import numpy as np

from fx_contact.plot.cut import cut_by_body


def test_each_body_shows_its_own_stress():
    """Two cubes on each other, one stressed: the section jumps where they touch, and no point has both values."""
    z, y, x = (axis.ravel() for axis in np.meshgrid(*[[0.0, 1.0]] * 3, indexing="ij"))
    cube = np.stack([x, y, z], axis=1)
    corners, values = np.stack([cube, cube + [0, 0, 1]]), np.repeat([[0.0], [1.0]], 8, axis=1)
    sections = cut_by_body(corners, values, np.array([0, 1]), 0.5)
    assert len(sections) == 2
    for section, stress, bottom in zip(sections, (0.0, 1.0), (0.0, 1.0)):
        assert (section.points[:, 2].min(), section.points[:, 2].max()) == (bottom, bottom + 1), "the bodies touch"
        assert (section["stress"] == stress).all()
    together = cut_by_body(corners, values, np.array([0, 0]), 0.5)[0]
    assert together.n_points < sum(s.n_points for s in sections), "what VTK does where they are one body"
