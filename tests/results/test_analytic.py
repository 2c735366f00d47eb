"""Known solutions: in equilibrium with their loads, and what they tend to."""

import numpy as np
import pytest
from scipy.special import ellipe, ellipk

from fx_contact.results.analytic import Hertz, HertzEllipse, HertzLine, Persson


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


@pytest.mark.parametrize("radii", [(10.0, 25.0), (3.0, 2.0), (1.0, 1e3)])
def test_contact_on_an_ellipse(radii):
    """The curvatures are those of Johnson's complete elliptic integrals (4.26), whatever the order of the radii."""
    known = HertzEllipse(radii, modulus=2.0, force=0.1)
    b, a = sorted(known.semi_axes)
    e2 = 1 - (b / a) ** 2
    scale = known.max_pressure / 2.0 * b / (e2 * a * a)
    curvatures = scale * (ellipk(e2) - ellipe(e2)), scale * ((a / b) ** 2 * ellipe(e2) - ellipk(e2))
    assert np.allclose([1 / (2 * c) for c in curvatures], sorted(radii)[::-1], rtol=1e-9)
    assert known.semi_axes == HertzEllipse(radii[::-1], 2.0, 0.1).semi_axes[::-1]
    assert (known.semi_axes[0] < known.semi_axes[1]) == (radii[0] < radii[1])


def test_an_ellipse_may_be_a_circle():
    """Equal radii: a sphere on a plane."""
    known, circle = HertzEllipse((3.0, 3.0), 2.0, 0.1), Hertz(3.0, 2.0, 0.1)
    assert np.allclose(known.semi_axes, circle.contact_radius, rtol=1e-12)
    assert abs(known.max_pressure / circle.max_pressure - 1) < 1e-12
