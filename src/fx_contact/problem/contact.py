"""Contacts of a scene.  The constraint rows of each kind of contact are in `contact/row_kinds.py`."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_direction


class Contact(ABC):
    """Possible contact of a surface with an obstacle, or of two surfaces."""

    @property
    @abstractmethod
    def surfaces(self) -> tuple[str, ...]:
        """Names of surfaces of the root mesh: of the first body and, unless there is an obstacle, of the second."""

    @property
    @abstractmethod
    def unit_direction(self) -> FloatArray | None:
        """(3,), out of the first body, direction of the summed force [-]; None: sum of the normal forces."""

    @property
    @abstractmethod
    def data(self) -> list[str | float]:
        """Definition of the contact for JSON, compared with that in a checkpoint."""

    @property
    def name(self) -> str:
        """Name in records, from those of the surfaces."""
        return " on ".join(self.surfaces)


@dataclass(frozen=True)
class ContactPair(Contact):
    """Two surfaces that may touch, meshed alike: each facet of the first faces one of the second (`Pairing`).

    Contact forces are normal to the surfaces.  Raises SceneError for a surface with itself, or an invalid direction.

    Attributes:
        direction: from the first body to the second, of any length [-]; points face each other in this direction, and
            the contact force is summed along it.  None: closest points face each other, and magnitudes are summed.
    """

    first: str
    second: str
    direction: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if self.first == self.second:
            raise SceneError(f"surface {self.first!r} cannot be in contact with itself")
        _ = self.unit_direction  # raises an error for an invalid direction

    @property
    def surfaces(self) -> tuple[str, ...]:
        """Names of both surfaces."""
        return self.first, self.second

    @property
    def unit_direction(self) -> FloatArray | None:
        """(3,), `direction` normalised [-].  Raises SceneError if it is not a non-zero vector."""
        if self.direction is None:
            return None
        return check_direction(f"the direction of ({self.first!r}, {self.second!r})", self.direction)

    @property
    def data(self) -> list[str | float]:
        """Names and direction."""
        return [self.first, self.second, *map(float, () if self.direction is None else self.direction)]
