"""Rigid obstacles, by their signed distance g(x), positive outside, and its gradient, the normal out of the obstacle.

A body is outside if g(x + u) >= 0.  For small strain g(x + u) = g(x) + u . grad g(x).  All is local.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from fx_contact.items.boundary_conditions import evaluated
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_degrees, check_direction, check_number, check_vector, shown

#: Distance from an axis or a centre, relative to that from the apex or the radius, at which directions are rounding.
_ON_AXIS = 1e-12


class Obstacle(ABC):
    """A rigid body without a mesh."""

    #: In names of contacts.
    name: ClassVar[str]

    @abstractmethod
    def distances(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Signed distances (n,) [m] of points (n, 3) [m], and unit normals (n, 3) out of the obstacle.

        Raises SceneError for functions that give other shapes or values that are not finite.
        """


@dataclass(frozen=True)
class RigidPlane(Obstacle):
    """The half-space below a plane.

    Raises SceneError unless point and normal are three finite numbers, and the normal is not 0.

    Attributes:
        point: on the plane [m].
        normal: out of the obstacle, towards the body, of any length [-].
    """

    name = "rigid plane"

    point: tuple[float, float, float]
    normal: tuple[float, float, float]

    def __post_init__(self) -> None:
        check_vector("the point of a rigid plane", self.point)
        check_direction("the normal of a rigid plane", self.normal)

    @property
    def unit_normal(self) -> FloatArray:
        """(3,), `normal` normalised [-]."""
        return _unit(self.normal)

    def distances(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """As `Obstacle.distances`."""
        normal = self.unit_normal
        return (points - np.array(self.point)) @ normal, np.broadcast_to(normal, points.shape)


@dataclass(frozen=True)
class RigidSphere(Obstacle):
    """A ball, or with a negative radius all that is outside: a hollow sphere.

    Raises SceneError unless the centre is three finite numbers, and the radius one that is not 0.

    Attributes:
        centre: [m].
        radius: negative: the body is inside [m].
    """

    name = "rigid sphere"

    centre: tuple[float, float, float]
    radius: float

    def __post_init__(self) -> None:
        check_vector("the centre of a rigid sphere", self.centre)
        _check_radius("the radius of a rigid sphere", self.radius)

    def distances(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """As `Obstacle.distances`; the normal at the centre is along z."""
        return _around(points - np.array(self.centre), self.radius, np.array([0.0, 0.0, 1.0]))


@dataclass(frozen=True)
class RigidCylinder(Obstacle):
    """A cylinder without ends, or with a negative radius all that is outside: a bore.

    Raises SceneError unless point and axis are three finite numbers, the axis is not 0, and the radius a finite number
    that is not 0.

    Attributes:
        point: on the axis [m].
        axis: of any length [-].
        radius: negative: the body is inside [m].
    """

    name = "rigid cylinder"

    point: tuple[float, float, float]
    axis: tuple[float, float, float]
    radius: float

    def __post_init__(self) -> None:
        check_vector("the point of a rigid cylinder", self.point)
        check_direction("the axis of a rigid cylinder", self.axis)
        _check_radius("the radius of a rigid cylinder", self.radius)

    def distances(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """As `Obstacle.distances`; normals on the axis have one direction across it."""
        axis = _unit(self.axis)
        arm = points - np.array(self.point)
        return _around(arm - np.outer(arm @ axis, axis), self.radius, _across(axis))


@dataclass(frozen=True)
class RigidCone(Obstacle):
    """A cone without end; with an angle above 90 degrees all that is outside of a cone: a countersink.

    Raises SceneError unless apex and axis are three finite numbers, the axis is not 0, and the angle is between 0 and
    180 and not 90.

    Attributes:
        apex: [m].
        axis: from the apex into the obstacle, of any length [-].
        angle: between the axis and the surface, half of the opening [degrees]; 135 with the axis down, into the
            obstacle, is a seat of 90 degrees that opens upwards.
    """

    name = "rigid cone"

    apex: tuple[float, float, float]
    axis: tuple[float, float, float]
    angle: float

    def __post_init__(self) -> None:
        check_vector("the apex of a rigid cone", self.apex)
        check_direction("the axis of a rigid cone", self.axis)
        angle = check_degrees("the angle of a rigid cone", self.angle)
        if not (0 < angle < 180 and angle != 90):
            raise SceneError(
                f"the angle of a rigid cone, from its axis to its surface, must be 0 to 180 degrees and not 90 (a "
                f"plane), got {angle:g}: below 90 for a tip, above 90 for a seat, as 135 with the axis down into it"
            )

    def distances(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """As `Obstacle.distances`; on the axis the normal is along it, and the distance is that from the apex."""
        axis, angle = _unit(self.axis), np.radians(self.angle)
        arm = points - np.array(self.apex)
        along = arm @ axis
        radial = arm - np.outer(along, axis)
        radius, length = np.linalg.norm(radial, axis=1), np.linalg.norm(arm, axis=1)
        on_axis = radius <= _ON_AXIS * length
        # The surface is the ray along (cos, sin) in the plane of axis and radius; before its end the apex is closest.
        before = along * np.cos(angle) + radius * np.sin(angle) < 0
        distance = radius * np.cos(angle) - along * np.sin(angle)
        outward = np.cos(angle) * radial / np.where(on_axis, 1.0, radius)[:, None] - np.sin(angle) * axis
        side = 1.0 if self.angle < 90 else -1.0
        from_apex = side * arm / np.where(length > 0, length, 1.0)[:, None]
        distance = np.where(on_axis, -along, np.where(before, side * length, distance))
        outward = np.where(before[:, None], from_apex, outward)
        return distance, np.where(on_axis[:, None], -axis, outward)


@dataclass(frozen=True)
class RigidSurface(Obstacle):
    """An obstacle by two functions of positions (3, n) [m].

    Raises SceneError unless both are functions; a Scene does unless the gap grows along the normal by the
    distance, within a tenth (median over the contact surface).

    Attributes:
        gap: gives (n,), the distance along the normal, negative inside [m].
        normal: gives (3, n), out of the obstacle, of any length [-].
    """

    name = "rigid surface"

    gap: Callable[[FloatArray], npt.ArrayLike]
    normal: Callable[[FloatArray], npt.ArrayLike]

    def __post_init__(self) -> None:
        for what, value in (("gap", self.gap), ("normal", self.normal)):
            if not callable(value):
                raise SceneError(f"the {what} of a rigid surface must be a function of positions, got {shown(value)}")

    def distances(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """As `Obstacle.distances`, also its Raises: SceneError."""
        gap = evaluated("the gap of a rigid surface", self.gap, points)
        normal = evaluated("the normal of a rigid surface", self.normal, points, 3)
        length = np.linalg.norm(normal, axis=1)
        if (length == 0).any():
            raise SceneError(f"the normal of a rigid surface is zero at {points[length == 0][0]}")
        return gap, normal / length[:, None]


def _check_radius(what: str, value: float) -> None:
    """Raises SceneError unless a value is a finite number that is not 0."""
    if check_number(what, value) == 0:
        raise SceneError(f"{what} is zero: positive for a body outside, negative for one inside")


def _around(arm: FloatArray, radius: float, other: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distances and normals by vectors (n, 3) from a centre; the normal at the centre is `other` (3,)."""
    length, side = np.linalg.norm(arm, axis=1), np.sign(radius)
    central = length <= _ON_AXIS * abs(radius)
    normal = np.where(central[:, None], other, arm / np.where(central, 1.0, length)[:, None])
    return side * length - radius, side * normal


def _unit(vector: tuple[float, float, float]) -> FloatArray:
    """The unit vector (3,) of a vector that is not 0."""
    return check_direction("a direction", vector)


def _across(axis: FloatArray) -> FloatArray:
    """A unit vector (3,) across a unit vector (3,)."""
    across = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    return np.asarray(across / np.linalg.norm(across))
