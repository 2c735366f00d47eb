"""Material laws: linear, elastic, isotropic."""

from dataclasses import dataclass

from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_number

#: Young's moduli of any material in usual units: a gel of 1 Pa in GPa is 1e-9, diamond in dyn/cm^2 1.2e13.
_SOFTEST, _STIFFEST = 1e-10, 1e14


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
    def plane_strain_modulus(self) -> float:
        """E/(1 - nu^2) [Pa]."""
        return self.young / (1 - self.poisson**2)
