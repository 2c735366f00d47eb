"""Known solutions: in equilibrium with their loads, and what they tend to."""

import numpy as np
import pytest

from fx_contact.results import HertzLine, Persson


@pytest.mark.parametrize("play", [1.0, 0.01, 0.0])
def test_conforming_contact_carries_the_load(play):
    """The vertical part of the pressure on the arc is the force."""
    known = Persson(radius=2.0, modulus=5.0, play=play, force=0.1)
    points, weights = np.polynomial.legendre.leggauss(201)
    angle = known.half_angle * np.sin(np.pi / 2 * points)  # smooth at the ends of the contact
    weights = weights * known.half_angle * np.pi / 2 * np.cos(np.pi / 2 * points)
    assert abs(2.0 * (known.pressure(angle) * np.cos(angle)) @ weights / 0.1 - 1) < 1e-6
    assert known.pressure(known.half_angle) == 0 and abs(known.pressure(angle).max() / known.max_pressure - 1) < 1e-9


def test_conforming_contact_becomes_hertzian():
    """With much play the contact is that of two cylinders of nearly equal radii."""
    known = Persson(radius=2.0, modulus=5.0, play=0.5, force=1e-4)
    hertz = HertzLine(radius=2.0**2 / 0.5, modulus=2.5, force=1e-4)
    assert abs(known.max_pressure / hertz.max_pressure - 1) < 1e-3
    assert abs(2.0 * known.half_angle / hertz.half_width - 1) < 1e-3
