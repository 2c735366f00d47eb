"""Conditions and loads: displacements, symmetry planes, tractions, pressures, body forces.

Values are numbers, or functions of position as in dolfinx: of an array (3, n) of points.  Numbers are checked when the
condition is made, functions where they are evaluated.  All is local.
"""

from dataclasses import dataclass

import numpy as np

from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_number, check_vector, shown

COMPONENTS = "xyz"


@dataclass(frozen=True)
class Dirichlet:
    """Prescribed displacement components on a surface, along a curve or at a vertex.

    Attributes:
        where: name of a surface, curve or vertex of the root mesh.
        x, y, z: displacement [m], None where the component is free: a number, or a function of the undeformed positions
            (3, n) float64 [m] that gives (n,) float64.

    Raises:
        SceneError: no component is given, or one is neither a finite number nor a function.
    """

    where: str
    x: object = None
    y: object = None
    z: object = None

    def __post_init__(self):
        if not self.held.any():
            raise SceneError(f"the condition on {self.where!r} prescribes nothing: give x, y or z")
        for component, value in zip(COMPONENTS, (self.x, self.y, self.z)):
            if value is not None and not callable(value):
                check_number(f"the displacement {component} on {self.where!r}", value)

    @property
    def held(self):
        """(3,) bool, which components are prescribed."""
        return np.array([value is not None for value in (self.x, self.y, self.z)])

    @property
    def across(self):
        """(3, 3) float64, the projector on what is held [-]."""
        return np.diag(self.held.astype(float))

    def at(self, points):
        """Displacement at points.

        Args:
            points: (n, 3) float64 [m].

        Returns:
            (n, 3) float64 [m], NaN where the component is free.

        Raises:
            SceneError: a function that does not give a finite number for each point.
        """
        result = np.full((len(points), 3), np.nan)
        for component, value in enumerate((self.x, self.y, self.z)):
            if value is not None:
                what = f"the displacement {COMPONENTS[component]} on {self.where!r}"
                result[:, component] = evaluated(what, value, points, 1)[:, 0]
        return result


def merged(before, condition, values, same, position):
    """Displacements that several conditions prescribe at some points.

    Local.

    Args:
        before: (n, 3) float64, what others prescribe there [m], NaN where free.
        condition: Dirichlet, one more.
        values: (n, 3) float64, what it prescribes [m], NaN where free.
        same: largest difference of two conditions on one component [m].
        position: function of the number of a point that gives where it is (3,) [m].

    Returns:
        (n, 3) float64 [m], NaN where free.

    Raises:
        SceneError: another condition prescribes another value of a component.
    """
    clash = np.argwhere(np.abs(before - values) > same)
    if len(clash):
        point, component = clash[0]
        raise SceneError(
            f"component {COMPONENTS[component]} on {condition.where!r} is prescribed as {values[point, component]} "
            f"where another condition says {before[point, component]}, at {position(point)}: let them agree, or "
            "leave one out where they meet"
        )
    return np.where(condition.held, values, before)


@dataclass(frozen=True)
class SymmetryPlane:
    """A plane surface in which the body is cut by symmetry: no displacement across it, free along it.

    Attributes:
        surface: name of a surface of the root mesh, in one plane, whose normal is found from its facets.
    """

    surface: str

    @property
    def where(self):
        """The surface, by the name that it has in other conditions."""
        return self.surface

    def on(self, mesh):
        """The same as a displacement condition.

        Local.

        Args:
            mesh: RootMesh.

        Returns:
            Dirichlet across x, y or z, else ObliquePlane.

        Raises:
            SceneError: an unknown surface, or one that is not plane.
        """
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
    """What a symmetry plane holds that is not across an axis: u . n = 0.

    Attributes:
        where: name of its surface.
        normal: n, unit vector out of its first facet [-].
    """

    where: str
    normal: tuple[float, float, float]

    @property
    def across(self):
        """(3, 3) float64, n n^T [-]."""
        return np.outer(self.normal, self.normal)

    def check(self, values, largest, position):
        """See that what others prescribe at points of the plane is along it.

        Local.

        Args:
            values: (n, 3) float64 [m], NaN where free.
            largest: largest prescribed displacement [m]; across the plane `PLANE` of it counts as none, for the plane
                is no better known.
            position: function of the number of a point that gives where it is (3,) [m].

        Raises:
            SceneError: it is not.
        """
        moved = np.nan_to_num(values) @ self.normal
        away = np.flatnonzero(np.abs(moved) > PLANE * largest)
        if len(away):
            raise SceneError(
                f"the symmetry plane {self.where!r} holds the displacement across it, and another condition prescribes "
                f"{moved[away[0]]:.3g} there, at {position(away[0])}: prescribe none across it, or leave one out"
            )


#: Largest distance from a plane, relative to the surface's size: rounding of the mesh generator.
PLANE = 1e-6


@dataclass(frozen=True)
class Traction:
    """A surface force.

    Attributes:
        surface: name of a surface of the root mesh.
        value: force per undeformed area in x, y, z [Pa]: three numbers, or a function of the undeformed positions
            (3, n) float64 [m] that gives (3, n) float64.

    Raises:
        SceneError: value is neither three finite numbers nor a function.
    """

    surface: str
    value: object

    def __post_init__(self):
        if not callable(self.value):
            check_vector(self.what, self.value)

    @property
    def what(self):
        """What it is and where, for messages."""
        return f"the traction on {self.surface!r}"

    def at(self, points, normals):
        """Force per area.

        Args:
            points: (n, 3) float64 [m].
            normals: (n, 3) float64, outward unit normals there.

        Returns:
            (n, 3) float64 [Pa].

        Raises:
            SceneError: a function that does not give three finite numbers for each point.
        """
        return evaluated(self.what, self.value, points, 3)


@dataclass(frozen=True)
class Pressure:
    """A pressure on a surface, against its undeformed outward normal.

    Attributes:
        surface: name of a surface of the root mesh.
        value: pressure [Pa], positive into the body: a number, or a function of the undeformed positions (3, n) float64
            [m] that gives (n,) float64.

    Raises:
        SceneError: value is neither a finite number nor a function.
    """

    surface: str
    value: object

    def __post_init__(self):
        if not callable(self.value):
            check_number(self.what, self.value)

    @property
    def what(self):
        """What it is and where, for messages."""
        return f"the pressure on {self.surface!r}"

    def at(self, points, normals):
        """Force per area, (n, 3) float64 [Pa]: arguments and errors as of `Traction.at`."""
        return -evaluated(self.what, self.value, points, 1) * normals


@dataclass(frozen=True)
class BodyForce:
    """A force on the volume of a body, as its weight.

    Attributes:
        body: name of a body of the root mesh.
        value: force per undeformed volume in x, y, z [N/m^3]: three numbers, or a function of the undeformed positions
            (3, n) float64 [m] that gives (3, n) float64.

    Raises:
        SceneError: value is neither three finite numbers nor a function.
    """

    body: str
    value: object

    def __post_init__(self):
        if not callable(self.value):
            check_vector(self.what, self.value)

    @property
    def what(self):
        """What it is and where, for messages."""
        return f"the body force on {self.body!r}"

    def at(self, points):
        """Force per volume at points (n, 3) float64 [m]: (n, 3) float64 [N/m^3]; errors as `Traction.at`."""
        return evaluated(self.what, self.value, points, 3)


def evaluated(what, value, points, components):
    """A number, vector or function of position at points.

    Local.

    Args:
        what: it is, for messages.
        value: number, vector, or function of (3, n) float64 [m] that gives (n,) for one component, (3, n) for three.
        points: (n, 3) float64 [m].
        components: 1 or 3.

    Returns:
        (n, components) float64.

    Raises:
        SceneError: a function that gives something else, or a number that is not finite.
    """
    if not callable(value):
        return np.broadcast_to(np.array(value, dtype=np.float64), (len(points), components))
    shape = (len(points),) if components == 1 else (components, len(points))
    if not len(points):
        return np.empty((0, components))
    result = np.asarray(np.ma.filled(value(points.T.copy()), np.nan))
    if result.shape != shape or result.dtype.kind not in "fiu":
        raise SceneError(
            f"{what} is a function that must give an array of shape {shape} for points of shape {(3, len(points))}, "
            f"got {shown(result)}"
        )
    result = result.reshape(components, -1).T.astype(np.float64)
    bad = ~np.isfinite(result).all(axis=1)
    if bad.any():
        raise SceneError(
            f"{what} is {np.squeeze(result[bad][0])} at {points[bad][0]}: it must be finite on all of it"
        )
    return result
