"""Laws of friction."""

from dataclasses import dataclass

from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_number, shown


class TangentialLaw:
    """Tangential behaviour of a contact, as data; its forces: `law.tangential`."""


@dataclass(frozen=True)
class Coulomb(TangentialLaw):
    """Coulomb's law: tangential forces up to mu times the normal force.  Raises SceneError unless mu > 0.

    Attributes:
        coefficient: mu [-].
    """

    coefficient: float

    def __post_init__(self) -> None:
        check_number("the coefficient of friction", self.coefficient, positive=True)


@dataclass(frozen=True)
class Tresca(TangentialLaw):
    """Tresca's law: tangential tractions of closed contact up to a bound.  Raises SceneError unless it is positive.

    Attributes:
        bound: of the traction, whatever the pressure [Pa].
    """

    bound: float

    def __post_init__(self) -> None:
        check_number("the bound of Tresca's friction", self.bound, positive=True)


def friction_law(friction: float | TangentialLaw) -> TangentialLaw | None:
    """The law of a contact's argument `friction`, Coulomb's for a number; None: for 0.  Local.  Raises SceneError."""
    if isinstance(friction, TangentialLaw):
        return friction
    number = check_number("friction", friction)
    if number < 0:
        raise SceneError(f"friction must be a coefficient from 0 on, or Tresca(bound), got {shown(friction)}")
    return Coulomb(number) if number else None
