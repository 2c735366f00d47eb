"""Exact solutions for comparison.  All is local."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, Self, runtime_checkable

import numpy as np
import scipy  # loads its modules where they are used

from fx_contact.items.materials import Material
from fx_contact.parallel.arrays import FloatArray


@runtime_checkable
class KnownPressure(Protocol):
    """The pressure of round contact, as of `Hertz`."""

    @property
    def force(self) -> float:
        """F [N]."""

    @property
    def contact_radius(self) -> float:
        """a [m]."""

    @property
    def max_pressure(self) -> float:
        """p0 [Pa]."""

    def pressure(self, r: float | FloatArray) -> FloatArray:
        """Contact pressure [Pa] at radii r [m].  Local."""


@dataclass(frozen=True)
class Hertz:
    """Hertz's contact of two elastic spheres (half-space theory).

    Source: K. L. Johnson, Contact Mechanics, Cambridge University Press, 1985, section 4.2.

    Attributes:
        radius: effective R*, 1/R* = 1/R1 + 1/R2 [m].
        modulus: effective E*, 1/E* = (1 - nu1^2)/E1 + (1 - nu2^2)/E2 [Pa].
        force: F [N].
    """

    radius: float
    modulus: float
    force: float

    @property
    def contact_radius(self) -> float:
        """a = (3 F R* / (4 E*))^(1/3) [m]."""
        return (3 * self.force * self.radius / (4 * self.modulus)) ** (1 / 3)

    @property
    def max_pressure(self) -> float:
        """p0 = 3 F / (2 pi a^2) [Pa]."""
        return 1.5 * self.force / (np.pi * self.contact_radius**2)

    @property
    def approach(self) -> float:
        """delta = a^2 / R* [m], of distant points in half-spaces."""
        return self.contact_radius**2 / self.radius

    def pressure(self, r: float | FloatArray) -> FloatArray:
        """Contact pressure [Pa] at radii r [m], of any shape."""
        return self.max_pressure * np.sqrt(np.maximum(0.0, 1 - (np.asarray(r) / self.contact_radius) ** 2))

    @classmethod
    def of_equal_spheres(cls, radius: float, material: Material, force: float) -> Self:
        """Contact of two equal spheres of a radius [m], pressed together by a force [N]."""
        return cls(radius / 2, material.plane_strain_modulus / 2, force)


@dataclass(frozen=True)
class HertzEllipse:
    """Hertz's contact on an ellipse (half-space theory): a gap x^2 / (2 R_x) + y^2 / (2 R_y).

    For cylinders crossed at right angles R_x and R_y are their radii.

    Source: K. L. Johnson, Contact Mechanics, Cambridge University Press, 1985, sections 3.5 and 4.2; his integrals are
    Carlson's R_D.

    Attributes:
        radii: R_x, R_y [m].
        modulus: effective E*, 1/E* = (1 - nu1^2)/E1 + (1 - nu2^2)/E2 [Pa].
        force: F [N].
    """

    radii: tuple[float, float]
    modulus: float
    force: float

    @cached_property
    def semi_axes(self) -> tuple[float, float]:
        """Those along x and y [m]: a^3 = F R_D(0, k^2, 1) R / (pi E*) and k a, where R is the larger radius.

        k solves R_D(0, 1, k^2) / R_D(0, k^2, 1) = R / R', where R' is the smaller radius.
        """
        (least, most), carlson = sorted(self.radii), scipy.special.elliprd
        k = scipy.optimize.brentq(lambda k: least * carlson(0, 1, k * k) - most * carlson(0, k * k, 1), 1e-6, 1.0)
        a = float(np.cbrt(self.force * carlson(0, k * k, 1) * most / (np.pi * self.modulus)))
        return (k * a, a) if self.radii[0] < self.radii[1] else (a, k * a)

    @property
    def max_pressure(self) -> float:
        """p0 = 3 F / (2 pi a b) [Pa]."""
        return float(1.5 * self.force / (np.pi * np.prod(self.semi_axes)))


@dataclass(frozen=True)
class HertzLine:
    """Hertz's contact of two parallel cylinders (half-space theory, plane strain).

    Source: K. L. Johnson, Contact Mechanics, Cambridge University Press, 1985, section 4.2(c).

    Attributes:
        radius: effective R*, 1/R* = 1/R1 + 1/R2 [m].
        modulus: effective E*, 1/E* = (1 - nu1^2)/E1 + (1 - nu2^2)/E2 [Pa].
        force: F per length [N/m].
    """

    radius: float
    modulus: float
    force: float

    @property
    def half_width(self) -> float:
        """a = (4 F R* / (pi E*))^(1/2) [m]."""
        return float(np.sqrt(4 * self.force * self.radius / (np.pi * self.modulus)))

    @property
    def max_pressure(self) -> float:
        """p0 = 2 F / (pi a) [Pa]."""
        return 2 * self.force / (np.pi * self.half_width)


@dataclass(frozen=True)
class Persson:
    """Conforming contact of a shaft in a bore with clearance: a disc and an infinite plate, plane strain.

    Source: A. Persson, On the stress distribution of cylindrical elastic bodies in contact, Chalmers, 1964, after M.
    Ciavarella, P. Decuzzi, Int. J. Solids Structures 38 (2001) 4507-4523, for bodies of one material.

    Attributes:
        radius: R of the bore [m].
        modulus: E / (1 - nu^2) [Pa].
        play: difference of the radii, not negative [m].
        force: Q per length [N/m].
    """

    radius: float
    modulus: float
    play: float
    force: float

    @cached_property
    def _b(self) -> float:
        """b = tan(half angle / 2), at which E* play / Q = 2 (1 - b^2) / (pi b^2) - I(b) / (pi^2 b^2 (1 + b^2)) [-]."""

        def excess(b: float) -> float:
            """Left side less right side [-]."""
            integral = scipy.integrate.quad(
                lambda y: 2 * np.arctanh(np.sqrt((b * b - y * y) / (1 + b * b))) / (1 + y * y), -b, b
            )[0]
            play = 2 * (1 - b * b) / (np.pi * b * b) - integral / (np.pi * b) ** 2 / (1 + b * b)
            return play - self.modulus * self.play / self.force

        return scipy.optimize.brentq(excess, 1e-6, 1.0)

    @property
    def half_angle(self) -> float:
        """Angle from the middle of the contact to its ends [rad]."""
        return float(2 * np.arctan(self._b))

    @property
    def max_pressure(self) -> float:
        """Maximum pressure, in the middle [Pa]."""
        return float(self.pressure(0.0))

    def pressure(self, angle: float | FloatArray) -> FloatArray:
        """Contact pressure [Pa] at angles [rad] from the middle, of any shape."""
        b2, y = self._b**2, np.tan(np.asarray(angle) / 2)
        root = np.sqrt(np.maximum(0.0, b2 - y**2) / (1 + b2))
        spread = 2 * root / (1 + y**2) + np.arctanh(root) / (b2 * (1 + b2))
        return self.force / (np.pi * self.radius) * np.where(np.abs(angle) < np.pi, spread, 0.0)


@dataclass(frozen=True)
class ShrinkFit:
    """Two concentric rings with an interference, free along their axis (plane stress), after Lame.

    Source: S. P. Timoshenko, J. N. Goodier, Theory of Elasticity, McGraw-Hill, 1970, section 28.

    Attributes:
        radii: a, b, c: inner, common and outer radius [m].
        interference: difference of the unloaded radii [m].
        inner, outer: materials.
    """

    radii: tuple[float, float, float]
    interference: float
    inner: Material
    outer: Material

    @property
    def pressure(self) -> float:
        """p = interference / (b ((c^2 + b^2)/(c^2 - b^2) + nu_o)/E_o + b ((b^2 + a^2)/(b^2 - a^2) - nu_i)/E_i) [Pa]."""
        a2, b2, c2 = np.square(self.radii)
        outward = ((c2 + b2) / (c2 - b2) + self.outer.poisson) / self.outer.young
        inward = ((b2 + a2) / (b2 - a2) - self.inner.poisson) / self.inner.young
        return float(max(self.interference, 0.0) / (self.radii[1] * (outward + inward)))
