"""Boundary conditions and loads: displacements, symmetry planes, tractions, pressures, body forces.

Values are numbers, checked when the condition is made, or functions of positions (3, n) as in dolfinx, checked when
evaluated.  All is local.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from typing import Any, ClassVar, TypeAlias

import numpy as np
import numpy.typing as npt

from fx_contact.geometry.hexahedral_mesh import PLANE
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.parallel.arrays import BoolArray, FloatArray
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_label, check_number, check_vector, is_function, shown

#: A number, or a function of positions (3, n) [m] that gives (n,).
ScalarValue: TypeAlias = float | Callable[[FloatArray], npt.ArrayLike]
#: Three numbers, or a function of positions (3, n) [m] that gives (3, n).
VectorValue: TypeAlias = Sequence[float] | FloatArray | Callable[[FloatArray], npt.ArrayLike]
#: Nine numbers, a symmetric 3 x 3 tensor, or a function of positions (3, n) [m] that gives (3, 3, n).
TensorValue: TypeAlias = Sequence[Sequence[float]] | FloatArray | Callable[[FloatArray], npt.ArrayLike]
Value: TypeAlias = ScalarValue | VectorValue | TensorValue

COMPONENTS = "xyz"


@dataclass(frozen=True)
class Placed:
    """An item of a scene at a place of the mesh, its first field."""

    #: With an article and a preposition, for messages.
    KIND: ClassVar[str]

    @property
    def place(self) -> str:
        """Name of the place."""
        return getattr(self, fields(self)[0].name)

    @property
    def what(self) -> str:
        """Kind and place, for messages."""
        return f"{self.KIND} {self.place!r}"


@dataclass(frozen=True)
class Dirichlet:
    """Prescribed displacement components on a surface, along a curve or at a vertex of the root mesh.

    Raises SceneError if the place has no name, no component is given, or one is neither a finite number nor a function.

    Attributes:
        x, y, z: displacement [m], constant or a function of the undeformed position; None where the component is free.
    """

    where: str
    x: ScalarValue | None = None
    y: ScalarValue | None = None
    z: ScalarValue | None = None

    def __post_init__(self) -> None:
        check_label("the place of a displacement condition", self.where)
        if not self.held.any():
            raise SceneError(f"the condition on {self.where!r} prescribes nothing: give x, y or z")
        for component, value in self._given:
            check_value(self._what(component), value, 1)

    @property
    def _given(self) -> list[tuple[int, ScalarValue]]:
        """Prescribed components and their values."""
        return [(i, value) for i, value in enumerate((self.x, self.y, self.z)) if value is not None]

    def _what(self, component: int) -> str:
        return f"the displacement {COMPONENTS[component]} on {self.where!r}"

    @property
    def held(self) -> BoolArray:
        """(3,), the prescribed components."""
        return np.array([value is not None for value in (self.x, self.y, self.z)])

    @property
    def components(self) -> str:
        """Names of the prescribed components."""
        return "".join(COMPONENTS[component] for component, _ in self._given)

    @property
    def across(self) -> FloatArray:
        """(3, 3), projector on the prescribed components [-]."""
        return np.diag(self.held.astype(float))

    def at(self, points: FloatArray) -> FloatArray:
        """Displacement (n, 3) [m] at points (n, 3) [m], NaN where free; errors of `evaluated`."""
        result = np.full((len(points), 3), np.nan)
        for component, value in self._given:
            result[:, component] = evaluated(self._what(component), value, points)
        return result


@dataclass(frozen=True)
class RigidMotion(Dirichlet):
    """Prescribed motion of a surface, a curve or a vertex as a rigid body, in all three components.

    u = t + r x (x - c) with the translation t, the rotation vector r and the centre c.  Rotations are
    small: lines across r become longer by |r|^2 / 2.  The force and moment that it takes are a `Resultant` of the kind
    "reaction".

    Raises SceneError as `Dirichlet`, or if a vector is not three finite numbers.

    Attributes:
        translation: t [m].
        rotation: r [rad].
        centre: c, undeformed [m].
    """

    x: ScalarValue | None = field(init=False, repr=False, compare=False)
    y: ScalarValue | None = field(init=False, repr=False, compare=False)
    z: ScalarValue | None = field(init=False, repr=False, compare=False)
    translation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("translation", "rotation", "centre"):
            what = f"the {name} of the rigid motion of {shown(self.where)}"
            object.__setattr__(self, name, check_vector(what, getattr(self, name)))
        for component, number, slope in zip(COMPONENTS, self.translation, np.cross(self.rotation, np.eye(3)).T):
            value = partial(_of_motion, number, np.array(slope), self.centre) if slope.any() else number
            object.__setattr__(self, component, value)
        super().__post_init__()


def _of_motion(number: float, slope: FloatArray, centre: Sequence[float], x: FloatArray) -> FloatArray:
    """A component (n,) of a rigid motion at positions (3, n) [m]: a number plus slope . (x - centre)."""
    return number + slope @ (x - np.array(centre)[:, None])


def merged(
    before: FloatArray, condition: Dirichlet, values: FloatArray, same: float, position: Callable[[int], FloatArray]
) -> FloatArray:
    """Displacements (n, 3) [m] at points on which several conditions act, NaN where free.

    Raises SceneError if two conditions prescribe different values of a component.

    Args:
        before: (n, 3), prescribed by other conditions than `condition` [m].
        values: (n, 3), prescribed by `condition` [m].
        same: tolerance for the difference of two values [m].
        position: maps the index of a point to its position (3,) [m].
    """
    clash = np.argwhere(np.abs(before - values) > same)
    if len(clash):
        point, component = clash[0].tolist()
        raise SceneError(
            f"component {COMPONENTS[component]} on {condition.where!r} is prescribed as {values[point, component]} "
            f"where another condition says {before[point, component]}, at {position(point)}: let them agree, or "
            "leave one out where they meet"
        )
    return np.where(condition.held, values, before)


@dataclass(frozen=True)
class SymmetryPlane:
    """Symmetry condition on a named plane surface: zero normal displacement, free tangential displacement."""

    surface: str

    @property
    def where(self) -> str:
        """The surface, under the name that other conditions use."""
        return self.surface

    def on(self, mesh: RootMesh) -> Dirichlet | ObliquePlane:
        """The condition on a mesh, Dirichlet for a plane across x, y or z.  Raises SceneError unless it is plane."""
        facets = mesh.surface(self.surface)
        points = mesh.facet_points(facets).reshape(-1, 3)
        extent = np.ptp(points, axis=0)
        axis = int(extent.argmin())
        if extent[axis] <= PLANE * extent.max():
            return Dirichlet(self.surface, **{COMPONENTS[axis]: 0.0})
        normals = mesh.outward_normals(facets)
        normal = np.linalg.svd(normals, full_matrices=False)[2][0]
        normal *= np.sign(normal @ normals[0])
        height = np.ptp(points @ normal)
        if height > PLANE * extent.max():
            raise SceneError(
                f"the symmetry plane {self.surface!r} must be plane: its facets extend over {extent}, and over "
                f"{height:.3g} along their mean normal; name plane facets only, those of each plane by themselves"
            )
        return ObliquePlane(self.surface, tuple(normal.tolist()))


@dataclass(frozen=True)
class ObliquePlane:
    """Symmetry condition u . n = 0 on the surface `where`, with n its unit normal, not along an axis."""

    where: str
    normal: tuple[float, float, float]

    @property
    def components(self) -> str:
        """Direction of the prescribed component, for messages."""
        return f"across {', '.join(f'{round(x, 3) + 0.0:g}' for x in self.normal)}"

    @property
    def across(self) -> FloatArray:
        """(3, 3), n n^T [-]."""
        return np.outer(self.normal, self.normal).astype(np.float64)

    def check(self, values: FloatArray, largest: float, position: Callable[[int], FloatArray]) -> None:
        """Raises SceneError unless displacements prescribed by other conditions are tangential to the plane.

        Args:
            values: (n, 3), at points of the plane [m], NaN where free.
            largest: largest prescribed displacement [m]; normal components up to `PLANE` times this count as zero.
            position: maps the index of a point to its position (3,) [m].
        """
        moved = np.nan_to_num(values) @ self.normal
        away = np.flatnonzero(np.abs(moved) > PLANE * largest)
        if len(away):
            raise SceneError(
                f"the symmetry plane {self.where!r} holds the displacement across it, and another condition prescribes "
                f"{moved[away[0]]:.3g} there, at {position(int(away[0]))}: prescribe none across it, or leave one out"
            )


@dataclass(frozen=True)
class Traction(Placed):
    """A force per undeformed area in x, y, z [Pa], constant or a function of the undeformed position.

    Raises SceneError if the value is neither three finite numbers nor a function.
    """

    KIND = "the traction on"

    surface: str
    value: VectorValue

    def __post_init__(self) -> None:
        check_value(self.what, self.value, 3)

    def at(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Force per area (n, 3) [Pa] at points (n, 3) [m] with outward unit normals (n, 3); errors of `evaluated`."""
        return evaluated(self.what, self.value, points, 3)


@dataclass(frozen=True)
class Pressure(Placed):
    """A pressure [Pa] against the undeformed outward normal, constant or a function of the undeformed position.

    Raises SceneError if the value is neither a finite number nor a function.
    """

    KIND = "the pressure on"

    surface: str
    value: ScalarValue

    def __post_init__(self) -> None:
        check_value(self.what, self.value, 1)

    def at(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Force per area (n, 3) [Pa], as `Traction.at`."""
        return -evaluated(self.what, self.value, points)[:, None] * normals


@dataclass(frozen=True)
class BodyForce(Placed):
    """A force per undeformed volume in x, y, z [N/m^3], such as weight, constant or a function of the position.

    It acts on a body with all its parts, or on the part that is named.

    Raises SceneError if the value is neither three finite numbers nor a function.
    """

    KIND = "the body force on"

    body: str
    value: VectorValue

    def __post_init__(self) -> None:
        check_value(self.what, self.value, 3)

    def at(self, points: FloatArray) -> FloatArray:
        """Force per volume (n, 3) [N/m^3] at points (n, 3) [m]; errors of `evaluated`."""
        return evaluated(self.what, self.value, points, 3)


def check_value(what: str, value: ScalarValue | VectorValue, components: int) -> None:
    """Raises SceneError unless a value is a function, or so many finite numbers."""
    if not is_function(what, value):
        check_number(what, value) if components == 1 else check_vector(what, value)


def called(what: str, function: Callable[[FloatArray], Any], points: FloatArray) -> Any:
    """Values of a user's function at points (n, 3) [m].  Local.  Raises SceneError if it takes no array of them."""
    try:
        return function(points.T.copy())
    except (TypeError, ValueError) as error:
        raise SceneError(
            f"{what} must be a function of one array (3, n) of positions, which chooses by numpy.where, not if: {error}"
        ) from error


def evaluated(what: str, value: Value, points: FloatArray, *shape: int) -> FloatArray:
    """Values (n, *shape) of a condition or load at points (n, 3) [m].

    Raises SceneError, its message beginning with `what`, for values of another shape or not finite, or as `called`.
    """
    if not callable(value):
        return np.broadcast_to(np.array(value, dtype=np.float64), (len(points), *shape))
    if not len(points):
        return np.empty((0, *shape))
    filled: Any = np.ma.filled  # NumPy's stub has no annotations
    given = np.asarray(filled(called(what, value, points), np.nan))
    if given.shape != (*shape, len(points)) or given.dtype.kind not in "fiu":
        raise SceneError(
            f"{what} is a function that must give an array of shape {(*shape, len(points))} for points of shape "
            f"{(3, len(points))}, got {shown(given)}"
        )
    result = np.moveaxis(given, -1, 0).astype(np.float64)
    bad = ~np.isfinite(result.reshape(len(points), -1)).all(axis=1)
    if bad.any():
        raise SceneError(f"{what} is {result[bad][0]} at {points[bad][0]}: it must be finite on all of it")
    return result
