"""Exact solutions to compare with."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Hertz:
    """Hertz's contact of two elastic spheres (half-space theory).

    K. L. Johnson, Contact Mechanics, Cambridge University Press, 1985, section 4.2.

    Attributes:
        radius: effective R*, 1/R* = 1/R1 + 1/R2 [m].
        modulus: effective E*, 1/E* = (1 - nu1^2)/E1 + (1 - nu2^2)/E2 [Pa].
        force: F [N].
    """

    radius: float
    modulus: float
    force: float

    @property
    def contact_radius(self):
        """a = (3 F R* / (4 E*))^(1/3) [m]."""
        return (3 * self.force * self.radius / (4 * self.modulus)) ** (1 / 3)

    @property
    def max_pressure(self):
        """p0 = 3 F / (2 pi a^2) [Pa]."""
        return 1.5 * self.force / (np.pi * self.contact_radius**2)

    @property
    def approach(self):
        """delta = a^2 / R* [m], of points far away in half-spaces."""
        return self.contact_radius**2 / self.radius

    def pressure(self, r):
        """Contact pressure [Pa] at radii r [m], of any shape."""
        return self.max_pressure * np.sqrt(np.maximum(0.0, 1 - (np.asarray(r) / self.contact_radius) ** 2))

    @classmethod
    def of_equal_spheres(cls, radius, material, force):
        """Two spheres of one radius [m] and one Material, pressed together by a force [N]."""
        return cls(radius / 2, material.plane_strain_modulus / 2, force)
