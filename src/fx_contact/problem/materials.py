"""Materials of bodies: linear, elastic, isotropic."""

from dataclasses import dataclass

from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_number

#: Softest material of which energies are double precision numbers, the inverse of the hardest [Pa].
_SOFTEST = 1e-100


@dataclass(frozen=True)
class Material:
    """An isotropic linear elastic material.

    Attributes:
        young: Young's modulus E [Pa], positive.
        poisson: Poisson's ratio nu [-], in (-1, 0.5).

    Raises:
        SceneError: a value outside its range.
    """

    young: float
    poisson: float

    def __post_init__(self):
        for name, what in (("young", "Young's modulus"), ("poisson", "Poisson's ratio")):
            object.__setattr__(self, name, check_number(what, getattr(self, name)))
        if self.young <= 0:
            raise SceneError(f"Young's modulus must be positive, got {self.young}")
        if not _SOFTEST <= self.young <= 1 / _SOFTEST:
            raise SceneError(f"energies of a Young's modulus of {self.young} Pa are no numbers: check its unit")
        if not -1 < self.poisson < 0.5:
            raise SceneError(f"Poisson's ratio must lie between -1 and 0.5 (excluded), got {self.poisson}")

    @property
    def plane_strain_modulus(self):
        """E/(1 - nu^2) [Pa]."""
        return self.young / (1 - self.poisson**2)
