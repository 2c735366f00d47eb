"""Material laws: linear, elastic, isotropic."""

from dataclasses import dataclass

from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_number


@dataclass(frozen=True)
class Material:
    """Isotropic linear elastic material.  Raises SceneError for a value outside its range.

    Attributes:
        young: Young's modulus E [Pa], positive.
        poisson: Poisson's ratio nu [-], in (-1, 0.5).
    """

    young: float
    poisson: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "young", check_number("Young's modulus", self.young, positive=True))
        object.__setattr__(self, "poisson", check_number("Poisson's ratio", self.poisson))
        if not -1 < self.poisson < 0.5:
            raise SceneError(f"Poisson's ratio must lie between -1 and 0.5 (excluded), got {self.poisson}")

    @property
    def plane_strain_modulus(self) -> float:
        """E/(1 - nu^2) [Pa]."""
        return self.young / (1 - self.poisson**2)
