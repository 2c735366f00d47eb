"""Material laws: linear, elastic, isotropic or orthotropic."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_direction, check_number, check_vector

#: Components of a symmetric tensor, of stresses in the order of W. Voigt.
VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
#: Position in `VOIGT` of each component of a symmetric tensor.
TENSOR = ((0, 5, 4), (5, 1, 3), (4, 3, 2))
#: Poisson's ratio from which on the volume strain of an isotropic body is projected.
LOCKING_POISSON = 0.4

#: Young's moduli of any material in usual units: a gel of 1 Pa in GPa is 1e-9, diamond in dyn/cm^2 1.2e13.
_SOFTEST, _STIFFEST = 1e-10, 1e14
#: Largest cosine of the angle between two material axes: rounding.
_PERPENDICULAR = 1e-6


@dataclass(frozen=True)
class Material:
    """Isotropic linear elastic material.  Raises SceneError for a value outside its range.

    Attributes:
        young: Young's modulus E [Pa], 1e-10 to 1e14.
        poisson: Poisson's ratio nu [-], in (-1, 0.5).
    """

    young: float
    poisson: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "young", check_number("Young's modulus", self.young, positive=True))
        object.__setattr__(self, "poisson", check_number("Poisson's ratio", self.poisson))
        if not _SOFTEST <= self.young <= _STIFFEST:
            raise SceneError(
                f"Young's modulus {self.young:g} is that of no material in any usual unit ({_SOFTEST:g} to "
                f"{_STIFFEST:g}): check it"
            )
        if not -1 < self.poisson < 0.5:
            raise SceneError(f"Poisson's ratio must lie between -1 and 0.5 (excluded), got {self.poisson}")

    @property
    def isotropic(self) -> "Material":
        """The material itself."""
        return self

    @property
    def projected(self) -> bool:
        """True if it is nearly incompressible: its volume strain is projected."""
        return self.poisson >= LOCKING_POISSON

    @property
    def plane_strain_modulus(self) -> float:
        """E/(1 - nu^2) [Pa]."""
        return self.young / (1 - self.poisson**2)

    @property
    def lame(self) -> tuple[float, float]:
        """Lame's coefficients lambda and mu [Pa]."""
        shear = self.young / (2 * (1 + self.poisson))
        return self.young * self.poisson / ((1 + self.poisson) * (1 - 2 * self.poisson)), shear

    @property
    def stiffness(self) -> FloatArray:
        """(6, 6), stresses in the order of `VOIGT` from strains, with angles for shears [Pa]."""
        first, second = self.lame
        result = np.diag([2.0, 2, 2, 1, 1, 1]) * second
        result[:3, :3] += first
        return result

    @property
    def text(self) -> str:
        """The constants, for people."""
        return f"E = {self.young:.5g}, nu = {self.poisson:.5g}"


@dataclass(frozen=True)
class Orthotropic:
    """Orthotropic linear elastic material: rolled sheet, wood, a layer of fibres.

    Strains are eps_i = sigma_i / E_i - sum_j nu_ji sigma_j / E_j with nu_ji / E_j = nu_ij / E_i, and the angle
    gamma_ij = tau_ij / G_ij.  Source: R. M. Jones, Mechanics of Composite Materials, 1999, section 2.4.

    Raises:
        SceneError: a modulus that is not positive, ratios that allow negative energies, axes that are not
            perpendicular, or a material that is nearly incompressible, against two of its five deviatoric modes at
            least: its volume strain is not projected.

    Attributes:
        young: E_1, E_2, E_3 [Pa].
        poisson: nu_12, nu_13, nu_23 [-]; nu_ij is the contraction along j under tension along i.
        shear: G_12, G_13, G_23 [Pa].
        axes: directions of the axes 1 and 2, of any length [-]; 3 is across both.
    """

    #: As `Material.projected`.
    projected: ClassVar[bool] = False

    young: tuple[float, float, float]
    poisson: tuple[float, float, float]
    shear: tuple[float, float, float]
    axes: tuple[Sequence[float], Sequence[float]] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))

    def __post_init__(self) -> None:
        for name in ("young", "poisson", "shear"):
            what = f"{name} of an Orthotropic"
            check_vector(what, getattr(self, name))
            numbers = [check_number(what, value, positive=name != "poisson") for value in getattr(self, name)]
            object.__setattr__(self, name, tuple(numbers))
        if not isinstance(self.axes, Sequence) or len(self.axes) != 2:
            raise SceneError(f"the axes of an Orthotropic must be two directions, got {self.axes!r}")
        axes = [check_direction("an axis of an Orthotropic", axis) for axis in self.axes]
        if abs(axes[0] @ axes[1]) > _PERPENDICULAR:
            raise SceneError(f"the axes of an Orthotropic must be perpendicular, got {self.axes!r}")
        object.__setattr__(self, "axes", tuple(tuple(map(float, axis)) for axis in axes))
        if not (np.linalg.eigvalsh(self._compliance) > 0).all():
            raise SceneError(
                f"Poisson's ratios {self.poisson} allow strains of negative energy: nu_ij must be below "
                "(E_i / E_j)^(1/2), and all three together smaller; is nu_ij the contraction along j under tension "
                "along i?"
            )
        # The volume locks if at least two deviatoric modes are soft against it.  With a single one, as the rolling
        # shear of wood, other strains without change of volume are as stiff as the volume strain: projecting that alone
        # would not help.  K / G of an isotropic material is 2 (1 + nu) / (3 (1 - 2 nu)).
        bulk, most = 1 / self._compliance[:3, :3].sum(), 2 * (1 + LOCKING_POISSON) / (3 * (1 - 2 * LOCKING_POISSON))
        weights, deviator = np.sqrt([1, 1, 1, 0.5, 0.5, 0.5]), np.eye(6)  # in the notation of Kelvin
        deviator[:3, :3] -= 1 / 3
        modes = np.linalg.eigvalsh(deviator @ (self._compliance * np.outer(weights, weights)) @ deviator)  # 1 / (2 G)
        ratio = 2 * bulk * modes[-2]
        if ratio > most:
            raise SceneError(
                f"an Orthotropic whose bulk modulus is {ratio:.3g} times two of its shear moduli (of deviatoric modes) "
                f"is nearly incompressible, and would lock: limit {most:.3g}, that of nu = {LOCKING_POISSON}"
            )

    @property
    def _compliance(self) -> FloatArray:
        """(6, 6), strains from stresses in the axes of the material [1/Pa]."""
        e1, e2, _ = self.young
        nu12, nu13, nu23 = self.poisson
        result = np.diag(1 / np.array([*self.young, *self.shear[::-1]]))
        for i, j, value in ((0, 1, nu12 / e1), (0, 2, nu13 / e1), (1, 2, nu23 / e2)):
            result[i, j] = result[j, i] = -value
        return np.asarray(result)

    @cached_property
    def stiffness(self) -> FloatArray:
        """(6, 6), as `Material.stiffness`, along x, y, z."""
        one, other = np.array(self.axes)
        axes = np.stack([one, other, np.cross(one, other)], axis=1)
        along = np.linalg.inv(self._compliance)[np.ix_(np.ravel(TENSOR), np.ravel(TENSOR))].reshape(3, 3, 3, 3)
        turned = np.einsum("ia,jb,kc,ld,abcd->ijkl", axes, axes, axes, axes, along)
        i, j = np.array(VOIGT).T
        return np.asarray(turned[i[:, None], j[:, None], i, j])

    @cached_property
    def isotropic(self) -> Material:
        """The isotropic material nearest to it, by the means of the stiffness over all directions (W. Voigt, 1889)."""
        c = self.stiffness
        normal, across = c[:3, :3].trace(), c[0, 1] + c[0, 2] + c[1, 2]
        bulk, shear = (normal + 2 * across) / 9, (normal - across + 3 * c[3:, 3:].trace()) / 15
        return Material(9 * bulk * shear / (3 * bulk + shear), (3 * bulk - 2 * shear) / (6 * bulk + 2 * shear))

    @property
    def plane_strain_modulus(self) -> float:
        """E/(1 - nu^2) of the nearest isotropic material [Pa]."""
        return self.isotropic.plane_strain_modulus

    @property
    def text(self) -> str:
        """The constants, for people."""
        young, shear = (", ".join(f"{value:.5g}" for value in of) for of in (self.young, self.shear))
        return f"orthotropic, E = {young}, G = {shear}"
