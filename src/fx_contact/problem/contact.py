"""Contacts that a scene asks for.  The kind of a contact decides its rows: `contact/row_kinds.py`."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_direction


class Contact(ABC):
    """One surface that may touch an obstacle, or two surfaces that may touch each other.

    Attributes:
        surfaces: names of surfaces of the root mesh, the first one and, if there is a second body, the second one.
    """

    @property
    @abstractmethod
    def surfaces(self) -> tuple[str, ...]:
        """One or two names."""

    @property
    @abstractmethod
    def unit_direction(self) -> npt.NDArray[np.float64] | None:
        """(3,), out of the first body, along which the force is summed; None: along the normals."""

    @property
    @abstractmethod
    def data(self) -> list[str | float]:
        """All that defines it, as JSON can hold it: a checkpoint is compared by it."""

    @property
    def name(self) -> str:
        """The names of the surfaces, as records have them."""
        return " on ".join(self.surfaces)


@dataclass(frozen=True)
class ContactPair(Contact):
    """Two surfaces that may touch, meshed alike: each facet of the first faces one of the second (`Pairing`).

    Attributes:
        first, second: names of surfaces of the root mesh.
        direction: from the first body to the second, the direction in which points face each other, and along which the
            contact force is summed [-], of any length; None: the closest points face each other, and magnitudes are
            summed.  The forces act along the surfaces' normals, whatever the direction.

    Raises:
        SceneError: a surface is paired with itself, or the direction is not a non-zero vector.
    """

    first: str
    second: str
    direction: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if self.first == self.second:
            raise SceneError(f"surface {self.first!r} cannot be in contact with itself")
        _ = self.unit_direction  # as it must be

    @property
    def surfaces(self) -> tuple[str, ...]:
        """Both."""
        return self.first, self.second

    @property
    def unit_direction(self) -> npt.NDArray[np.float64] | None:
        """The direction as a unit vector, however long it was given: (3,).  Local.

        Raises:
            SceneError: it is not a non-zero vector; the pair is then not made.
        """
        if self.direction is None:
            return None
        return check_direction(f"the direction of ({self.first!r}, {self.second!r})", self.direction)

    @property
    def data(self) -> list[str | float]:
        """Names, then the direction."""
        return [self.first, self.second, *map(float, () if self.direction is None else self.direction)]
