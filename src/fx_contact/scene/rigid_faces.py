"""Surfaces of rigid loads in a scene, with the motions that its conditions allow.  All is local."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fx_contact.items.contact import Coupling
from fx_contact.items.motions import FaceMotion, rigid_motions
from fx_contact.items.rigid_loads import RigidLoad
from fx_contact.parallel.arrays import FloatArray, Int64Array
from fx_contact.parallel.errors import SceneError
from fx_contact.scene.mirrors import symmetry_planes

if TYPE_CHECKING:
    from fx_contact.scene.scene import Scene

#: Eigenvalues of R^T R, relative to the largest, and components of loads, that are rounding.
_ROUNDING = 1e-10, 1e-9


@dataclass(frozen=True, eq=False)
class RigidFace(Coupling):
    """The surface of a RigidLoad in a scene: rows of all its nodes, with the motions that its conditions allow."""

    surface: str
    face_motion: FaceMotion

    @property
    def motion(self) -> FaceMotion:
        """As `Contact.motion`."""
        return self.face_motion

    @property
    def surfaces(self) -> tuple[str, ...]:
        """The surface."""
        return (self.surface,)

    @property
    def data(self) -> list[str | float]:
        """Name alone: `RigidLoad.data` has the rest."""
        return [self.surface]

    @property
    def name(self) -> str:
        """Name in records."""
        return self.surface

    @property
    def label(self) -> str:
        """Name in messages."""
        return f"rigid load {self.surface!r}"


def rigid_face(scene: Scene, load: RigidLoad) -> RigidFace:
    """The face of a load in a scene.

    Raises SceneError if conditions hold all of it, move it, or hold what the load would move, or if it shares nodes
    with another contact, tie or rigid load.
    """
    mesh = scene.mesh
    corners = mesh.facet_points(mesh.surface(load.surface), order=1)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 2], corners[:, 3] - corners[:, 0]), axis=1)
    centroid = area @ corners.mean(axis=1) / area.sum()
    lever = np.zeros(3) if load.point is None else np.array(load.point, dtype=np.float64) - centroid
    nodes = scene.place(load.surface)
    others = [other.surface for other in scene.rigid_loads if other is not load]
    others += [name for contact in (*scene.contact, *scene.ties) for name in contact.surfaces]
    for name in others:
        if np.isin(nodes, scene.place(name)).any():
            raise SceneError(
                f"{load.what} shares nodes with the surface {name!r} of a contact, tie or rigid load: name facets "
                "away from its rim"
            )
    size = float(np.linalg.norm(mesh.points[nodes] - centroid, axis=1).max())
    held = _held(scene, load, nodes, centroid, size)
    values, vectors = np.linalg.eigh(held @ held.T)
    basis = vectors[:, values <= _ROUNDING[0] * max(values[-1], 1.0)]
    if not basis.shape[1]:
        raise SceneError(f"{load.what} moves nothing: conditions hold its surface; name another one")
    given = np.concatenate([load.force, (load.moment + np.cross(lever, load.force)) / size])
    far = max(size, float(np.linalg.norm(lever)))  # a scale of rotations about the point
    of_point = np.concatenate([basis[:3] + np.cross(basis[3:] / size, lever, axis=0), basis[3:] * far / size])
    asked = np.concatenate([load.force, np.array(load.moment) / far])
    allowed = np.linalg.qr(of_point)[0]
    lost = asked - allowed @ (allowed.T @ asked)
    if np.linalg.norm(lost) > _ROUNDING[1] * np.linalg.norm(asked):
        raise SceneError(
            f"{load.what} has the components {lost * np.repeat([1, far], 3)} of force and moment in "
            "directions that symmetry planes or conditions at its rim hold: leave these out, or model the whole"
        )
    return RigidFace(load.surface, FaceMotion(centroid, lever, size, basis, given))


def _held(scene: Scene, load: RigidLoad, nodes: Int64Array, centroid: FloatArray, size: float) -> FloatArray:
    """Displacements (6, m) [-] of the six motions that conditions at the surface prescribe.

    A mirrored face stays rigid with its image: displacements across a symmetry plane vanish on all of the plane.
    """
    prescribed = scene.prescribed(scene.mesh.points)[nodes]
    if np.nan_to_num(prescribed).any():
        raise SceneError(f"{load.what} and a condition both move nodes: let them share none, or hold those at 0")
    motions = rigid_motions(scene.mesh.points[nodes], centroid, size)
    held = [motions[:, ~np.isnan(prescribed[:, axis]), axis] for axis in range(3)]
    for surface, normal in symmetry_planes(scene):
        on = nodes[np.isin(nodes, scene.place(surface))][:1]
        inside = np.linalg.svd(normal[None])[2][1:]  # two directions in the plane
        there = scene.mesh.points[on][:, None] + size * np.concatenate([np.zeros((1, 3)), inside])
        held.append(rigid_motions(there.reshape(-1, 3), centroid, size) @ normal)
    return np.concatenate(held, axis=1)
