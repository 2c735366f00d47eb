"""Ties of a scene: surfaces that are glued.  Their constraint rows are those of contact, along each axis."""

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from fx_contact.items.contact import Coupling, union
from fx_contact.items.motions import Closing
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_direction, check_number, shown


@dataclass(frozen=True)
class Tie(Coupling):
    """Two surfaces that are glued, u_1 = u_2: they transmit pressure, tension and shear.

    Where facets and nodes of both coincide, rows are of pairs of nodes, else mortar rows on one surface, in
    whichever order they are given.  The undeformed distance of the sides remains; facets of one surface
    that face none of the other are free.

    Raises SceneError for a surface with itself.

    Attributes:
        first, second: names of the surfaces, of two bodies or of one; tuples of names for their unions.
    """

    KIND: ClassVar[str] = "tie"
    JOINT: ClassVar[str] = "tied to"

    first: str | tuple[str, ...]
    second: str | tuple[str, ...]

    def __post_init__(self) -> None:
        if not isinstance(self.first, str | tuple) or not isinstance(self.second, str | tuple):
            raise SceneError(
                f"a tie takes the names of two surfaces, got {shown(self.first)} and {shown(self.second)}"
            )
        if self.first == self.second:
            raise SceneError(f"surface {self.first!r} cannot be tied to itself")
        _ = self.surfaces  # raises an error for other tuples

    def reversed(self) -> Self:
        """The tie with the second surface first."""
        return type(self)(self.second, self.first)

    @property
    def surfaces(self) -> tuple[str, ...]:
        """Names of both surfaces."""
        return union(self.first), union(self.second)


@dataclass(frozen=True)
class Preload(Tie):
    """A cut through a bolt whose sides are pulled together: u_1 - u_2 = t n, with n the axis, by a tension or by t.

    The section is plane, across the axis.  With a `tension` the closing t is an unknown; a second scene whose `closing`
    is that of the first (`StepRecord.motions`) and whose tension is None is the tightened bolt below other loads.

    Raises SceneError as `Tie`, for an axis that is no direction, and for numbers that are not finite, or a tension
    below 0.

    Attributes:
        first, second: names of both sides of the cut.
        axis: of the bolt, from the first side to the second, of any length [-].
        tension: in the section, of all symmetric parts as forces in the records: of two bolts if one is modelled beside
            a symmetry plane; 0: not tightened yet [N].  None: the closing is given.
        closing: t, by which the bolt is shortened [m]; ignored beside a tension.
    """

    JOINT: ClassVar[str] = "bolted to"

    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    tension: float | None = None
    closing: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_direction(f"the axis of {self.label}", self.axis)
        if self.tension is not None:
            check_number(f"the tension of {self.label}, if not 0,", self.tension, positive=self.tension != 0)
        if self.closing is not None:
            check_number(f"the closing of {self.label}", self.closing)
        elif self.tension is None:
            raise SceneError(f"{self.label} has no preload: give a tension or a closing; 0 holds the length as it is")

    @property
    def unit_axis(self) -> FloatArray:
        """(3,), n [-].  Raises SceneError as the class."""
        return check_direction("the axis", self.axis)

    @property
    def motion(self) -> Closing | None:
        """As `Contact.motion`: the closing, with a tension."""
        return None if self.tension is None else Closing(-self.unit_axis, float(self.tension))

    def opening(self, positions: FloatArray) -> FloatArray | None:
        """As `Contact.opening`: t n; with a tension the closing is unknown."""
        if self.closing is None or self.tension is not None:
            return None
        return np.tile(self.closing * self.unit_axis, (len(positions), 1))

    def reversed(self) -> Self:
        """The section with the second side first."""
        x, y, z = self.axis
        return replace(self, first=self.second, second=self.first, axis=(-x, -y, -z))
