"""Laws of friction."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_number, shown


class TangentialLaw(ABC):
    """Tangential behaviour of a contact, as data; its forces: `law.tangential`."""


class Friction(TangentialLaw):
    """A law of friction: stick below a bound of the tangential force, slip at it."""

    @abstractmethod
    def bounds(self, force: FloatArray, area: FloatArray) -> FloatArray:
        """Bounds (n,) [N] of tangential forces below normal forces (n,) [N] on areas (n,) [m^2].  Local."""

    @abstractmethod
    def derivative(self, force: FloatArray, area: FloatArray) -> FloatArray:
        """Derivative (n,) of `bounds` by the normal forces [-].  Local."""


@dataclass(frozen=True)
class Coulomb(Friction):
    """Coulomb's law: tangential forces up to mu times the normal force.  Raises SceneError unless mu > 0.

    Attributes:
        coefficient: mu [-].
    """

    coefficient: float

    def __post_init__(self) -> None:
        check_number("the coefficient of friction", self.coefficient, positive=True)

    def bounds(self, force: FloatArray, area: FloatArray) -> FloatArray:
        """As `Friction.bounds`.  Local."""
        return np.asarray(self.coefficient * np.maximum(force, 0.0))

    def derivative(self, force: FloatArray, area: FloatArray) -> FloatArray:
        """As `Friction.derivative`.  Local."""
        return np.where(force > 0, self.coefficient, 0.0)


@dataclass(frozen=True)
class Tresca(Friction):
    """Tresca's law: tangential tractions up to a bound, and up to the pressure.

    With a traction above the pressure a node could neither stay open nor closed, and there might be no solution.

    Raises SceneError unless the bound is positive.

    Attributes:
        bound: of the traction [Pa].
    """

    bound: float

    def __post_init__(self) -> None:
        check_number("the bound of Tresca's friction", self.bound, positive=True)

    def bounds(self, force: FloatArray, area: FloatArray) -> FloatArray:
        """As `Friction.bounds`.  Local."""
        return np.minimum(self.bound * area, np.maximum(force, 0.0))

    def derivative(self, force: FloatArray, area: FloatArray) -> FloatArray:
        """As `Friction.derivative`.  Local."""
        return np.where((force > 0) & (force < self.bound * area), 1.0, 0.0)


def friction_law(friction: float | TangentialLaw) -> TangentialLaw | None:
    """The law of a contact's argument `friction`, Coulomb's for a number; None: for 0.  Local.  Raises SceneError."""
    if isinstance(friction, TangentialLaw):
        return friction
    number = check_number("friction", friction)
    if number < 0:
        raise SceneError(f"friction must be a coefficient from 0 on, or Tresca(bound), got {shown(friction)}")
    return Coulomb(number) if number else None
