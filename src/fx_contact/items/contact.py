"""Contacts of a scene.  The constraint rows of each kind of contact are in `contact/row_kinds.py`."""

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from fx_contact.geometry.hexahedral_mesh import UNION
from fx_contact.items.friction import TangentialLaw, friction_law
from fx_contact.items.motions import Approach, Motion
from fx_contact.items.obstacles import Obstacle, RigidPlane
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_direction, check_number, check_vector, shown

#: Cosine of the angle between normals up to which they are those of a smooth surface: 15 degrees, as of the facets of a
#: circle of twelve cells.
SMOOTH = 0.966


class Contact(ABC):
    """Possible contact of a surface with an obstacle, or of two surfaces.

    Attributes:
        clearance: added to the gap, negative for interference [m].
        force: on the obstacle, along which it is free to move [N]; None: it does not move by itself.
        moved: displacement of the obstacle [m].
        direction: in which the surfaces face each other, of any length [-]; None: along their normals.
    """

    #: Rows are equations, always closed.
    EQUALITY: ClassVar[bool] = False
    #: Kind of its resultants, and what its name says between those of the surfaces.
    KIND: ClassVar[str] = "contact"
    JOINT: ClassVar[str] = "on"

    clearance: float = 0.0
    force: tuple[float, float, float] | None = None
    moved: tuple[float, float, float] = (0.0, 0.0, 0.0)
    direction: tuple[float, float, float] | None = None

    @property
    def tangential(self) -> TangentialLaw | None:
        """Law of the tangents; None: there are no tangential forces, and no rows for them."""
        return None

    @property
    def motion(self) -> Motion | None:
        """Unknown motions along given forces, if there are any."""
        return None

    def approached(self, distance: float) -> Self:
        """The contact whose obstacle has moved along its force by a distance [m].  Local."""
        return self

    def opening(self, positions: FloatArray) -> FloatArray | None:
        """Given gap vectors (n, 3) [m] of rows that are equations at positions (n, 3) [m]; None: 0.  Local."""
        return None

    @property
    @abstractmethod
    def surfaces(self) -> tuple[str, ...]:
        """Names of surfaces of the root mesh: of the first body and, unless there is an obstacle, of the second."""

    @property
    @abstractmethod
    def unit_direction(self) -> FloatArray | None:
        """(3,), out of the first body, direction of the summed force [-]; None: sum of the normal forces."""

    @property
    def obstacle(self) -> Obstacle | None:
        """The rigid obstacle, if there is one of the kinds of `items.obstacles`."""
        return None

    @property
    def name(self) -> str:
        """Name in records, from those of the surfaces, "surface on rigid sphere" for an obstacle."""
        return self._joined(self.surfaces)

    @property
    def label(self) -> str:
        """As `name`, with names of surfaces in quotes."""
        return self._joined(map(repr, self.surfaces))

    def _joined(self, names: Iterable[str]) -> str:
        return f" {self.JOINT} ".join([*names, *([] if self.obstacle is None else [self.obstacle.name])])


def union(names: str | tuple[str, ...]) -> str:
    """The name of the union of surfaces, "a + b", as `HexahedralMesh.surface` takes it.  Local.

    Raises SceneError for what is no name, and no tuple of different names.
    """
    every = (names,) if isinstance(names, str) else names
    if not isinstance(every, tuple) or not every or not all(isinstance(name, str) for name in every):
        raise SceneError(
            f"a contact or tie takes a surface by its name, or several by a tuple of names, got {shown(names)}"
        )
    if len(set(every)) < len(every):
        raise SceneError(f"a surface is twice in the union {shown(names)}")
    return UNION.join(every)


class Coupling(Contact):
    """An interface whose rows are equations along all axes, always closed."""

    EQUALITY: ClassVar[bool] = True

    @property
    def unit_direction(self) -> None:
        """Surfaces face each other along their normals."""
        return None


@dataclass(frozen=True)
class ContactPair(Contact):
    """A surface that may touch another one, or a rigid obstacle.

    Where each facet of the first surface faces one of the second (`Pairing`), rows are of pairs of nodes.  Other
    meshes have mortar rows on the surface of the softer body, of alike ones the finer surface, in whichever order they
    are given.  Without friction contact forces are normal to the surfaces, or to the obstacle.

    Raises SceneError for a surface with itself, an invalid direction, vector or number, a force that is zero or beside
    a `direction` or friction, or `moved` or `force` without an obstacle.

    Attributes:
        first: the name of a surface; a tuple of names is the union of these.
        second: the other surface, or the obstacle.
        direction: from the first body to the second, of any length [-]; points face each other in this direction, and
            the contact force is summed along it.  None: closest points face each other, and magnitudes are summed,
            on a plane along its normal.  From an obstacle closest points are taken in any case.
        moved: displacement of the obstacle [m], with a force the place from which it moves.
        clearance: added to the gap, negative for interference [m].
        force: on the obstacle, of all symmetric parts as forces in the records [N].  The obstacle is free to move
            along it, to where the contact force in this direction balances it; other translations and rotations are
            held.  None: it stays at `moved`.
        friction: coefficient mu of Coulomb's law [-], or another law, as Tresca(bound); 0: none.
    """

    first: str | tuple[str, ...]
    second: str | tuple[str, ...] | Obstacle
    direction: tuple[float, float, float] | None = None
    moved: tuple[float, float, float] = (0.0, 0.0, 0.0)
    clearance: float = 0.0
    force: tuple[float, float, float] | None = None
    friction: float | TangentialLaw = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.first, str | tuple) or not isinstance(self.second, str | tuple | Obstacle):
            wanted = "the name of a surface, then that of another one or an obstacle, as RigidSphere(centre, radius)"
            raise SceneError(f"a ContactPair takes {wanted}, got {shown(self.first)} and {shown(self.second)}")
        _ = self.surfaces  # raises an error for other tuples
        if self.first == self.second:
            raise SceneError(f"surface {self.first!r} cannot be in contact with itself")
        check_vector(f"the displacement of the obstacle below {self.first!r}", self.moved)
        check_number(f"the clearance of {self.first!r}", self.clearance)
        if self.obstacle is None and np.any(self.moved):
            raise SceneError(f"({self.first!r}, {self.second!r}) has no obstacle that could be moved")
        if self.force is not None:
            check_direction(f"the force on the obstacle below {self.first!r}", self.force)
            if self.obstacle is None:
                raise SceneError(f"({self.first!r}, {self.second!r}) has no obstacle that a force could press")
            if self.direction is not None:
                raise SceneError(f"{self.name!r} has a direction, that of the force: leave `direction` away")
            if self.tangential is not None:
                raise SceneError(
                    f"friction on {self.label}, an obstacle that a force moves, is not possible: move it by `moved`"
                )
        _ = self.tangential, self.unit_direction  # raises an error for an invalid direction

    @property
    def tangential(self) -> TangentialLaw | None:
        """As `Contact.tangential`."""
        return friction_law(self.friction)

    @property
    def obstacle(self) -> Obstacle | None:
        """As `Contact.obstacle`."""
        return self.second if isinstance(self.second, Obstacle) else None

    @property
    def surfaces(self) -> tuple[str, ...]:
        """Names of both surfaces, or of the one."""
        first = union(self.first)
        return (first,) if isinstance(self.second, Obstacle) else (first, union(self.second))

    def reversed(self) -> Self:
        """The contact of two surfaces with the second one first."""
        assert not isinstance(self.second, Obstacle)
        x, y, z = self.direction or (0.0, 0.0, 0.0)
        direction = None if self.direction is None else (-x, -y, -z)
        return replace(self, first=self.second, second=self.first, direction=direction)

    @property
    def unit_direction(self) -> FloatArray | None:
        """(3,), against the force, `direction` normalised, or into a plane [-].  Raises SceneError for no direction."""
        if self.force is not None:
            return -check_direction("the force", self.force)
        if self.direction is not None:
            return check_direction(f"the direction of {self.name!r}", self.direction)
        return -self.second.unit_normal if isinstance(self.second, RigidPlane) else None

    @property
    def motion(self) -> Approach | None:
        """As `Contact.motion`: the obstacle along the force on it."""
        if self.force is None or self.unit_direction is None:
            return None
        return Approach(self.unit_direction, float(np.linalg.norm(self.force)))

    def approached(self, distance: float) -> Self:
        """As `Contact.approached`.  Local."""
        assert self.unit_direction is not None, "against the force"
        x, y, z = np.array(self.moved) - distance * self.unit_direction
        return replace(self, moved=(float(x), float(y), float(z)))

    def distances(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distances (n,) [m] of points (n, 3) [m] from the moved obstacle, and unit normals (n, 3) into it.

        Local.  Raises SceneError as `Obstacle.distances`.
        """
        assert self.obstacle is not None
        distance, outward = self.obstacle.distances(points - np.array(self.moved, dtype=np.float64))
        return distance, -outward
