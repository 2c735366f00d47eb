"""Ties of a scene: surfaces that are glued.  Their constraint rows are those of contact, along each axis."""

from dataclasses import dataclass
from typing import Self

from fx_contact.parallel.errors import SceneError
from fx_contact.problem.contact import Contact


@dataclass(frozen=True)
class Tie(Contact):
    """Two surfaces that are glued, u_1 = u_2: they transmit pressure, tension and shear.

    Where facets and nodes of both coincide, rows are of pairs of nodes, else mortar rows on one surface, in
    whichever order they are given.  The undeformed distance of the sides remains; facets of one surface
    that face none of the other are free.

    Raises SceneError for a surface with itself.

    Attributes:
        first, second: names of the surfaces, of two bodies or of one.
    """

    first: str
    second: str

    def __post_init__(self) -> None:
        if self.first == self.second:
            raise SceneError(f"surface {self.first!r} cannot be tied to itself")

    def reversed(self) -> Self:
        """The tie with the second surface first."""
        return type(self)(self.second, self.first)

    @property
    def surfaces(self) -> tuple[str, ...]:
        """Names of both surfaces."""
        return self.first, self.second

    @property
    def direction(self) -> None:
        """As `unit_direction`."""
        return None

    @property
    def unit_direction(self) -> None:
        """Surfaces face each other along their normals."""
        return None

    @property
    def data(self) -> list[str | float]:
        """Names of both surfaces."""
        return [*self.surfaces]

    @property
    def name(self) -> str:
        """Name in records."""
        return f"{self.first} tied to {self.second}"

    @property
    def label(self) -> str:
        """As `name`, with names of surfaces in quotes."""
        return f"{self.first!r} tied to {self.second!r}"
