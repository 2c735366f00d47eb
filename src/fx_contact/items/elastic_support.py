"""Elastic supports: springs distributed over a surface (Winkler's bedding, a Robin condition).  All is local."""

from dataclasses import dataclass

import numpy as np

from fx_contact.geometry.rigid_motions import resisting_points
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.items.boundary_conditions import Placed
from fx_contact.parallel.arrays import FloatArray, IntArray
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_label, check_number


@dataclass(frozen=True)
class Elastic(Placed):
    """A surface on springs that are fixed at their other end; they push and pull.

    The force on the body per undeformed area is -k (u . n) n with `normal` k, and -(k_x u_x, k_y u_y, k_z u_z) with
    `x`, `y`, `z`; both add up.  `Elastic("bottom", 1e9)` is free to slide, `Elastic("bottom", x=k, y=k, z=k)` is not.

    Raises SceneError if the surface has no name, no stiffness is given, or one is not a positive number.

    Attributes:
        normal: stiffness per area along the undeformed normal n [N/m^3]; None: 0.
        x, y, z: stiffness per area along the axes [N/m^3]; None: 0.
    """

    KIND = "the elastic support on"

    surface: str
    normal: float | None = None
    x: float | None = None
    y: float | None = None
    z: float | None = None

    def __post_init__(self) -> None:
        check_label("the surface of an elastic support", self.surface)
        given = {name: value for name, value in vars(self).items() if name != "surface" and value is not None}
        if not given:
            raise SceneError(f"{self.what} has no stiffness: give normal, or some of x, y, z")
        for name, value in given.items():
            check_number(f"the stiffness {name} of {self.what}", value, positive=True)

    @property
    def along_axes(self) -> FloatArray:
        """(3,), stiffness per area along x, y and z, without `normal` [N/m^3]."""
        return np.array([value or 0.0 for value in (self.x, self.y, self.z)])

    def stiffness(self, normals: FloatArray) -> FloatArray:
        """Stiffness per area (n, 3, 3) [N/m^3] on surfaces with unit normals (n, 3)."""
        of_normal = (self.normal or 0.0) * normals[:, :, None] * normals[:, None]
        return np.asarray(of_normal + np.diag(self.along_axes))

    def resistance(self, mesh: RootMesh) -> tuple[FloatArray, IntArray, FloatArray]:
        """Points (n, 3) [m] at which bodies (n,) are held along unit vectors (n, 3) [-]."""
        facets = mesh.surface(self.surface)
        corners = mesh.facet_points(facets, order=1)
        held = [(corners, np.broadcast_to(axis, corners.shape)) for axis in np.eye(3)[self.along_axes > 0]]
        if self.normal is not None:
            normals = mesh.outward_normals(facets)
            points = resisting_points(mesh, facets, normals, np.ones(len(facets), dtype=bool))
            held.append((points, np.repeat(normals[:, None], 4, axis=1)))
        points, directions = (np.concatenate(parts).reshape(-1, 3) for parts in zip(*held))
        return points, np.tile(np.repeat(mesh.body[facets[:, 0]], 4), len(held)), directions
