"""Surfaces of rigid loads in a scene, with the motions that its conditions allow.  All is local."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.items.contact import Coupling
from fx_contact.items.motions import FaceMotion, rigid_displacements
from fx_contact.items.rigid_loads import RigidLoad
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import SceneError
from fx_contact.scene.mirrors import PlaneSurface

#: Eigenvalues of R^T R, relative to the largest, and components of loads, that are rounding.
_ROUNDING = 1e-10, 1e-9


@dataclass(frozen=True, eq=False)
class RigidFace(Coupling):
    """The surface of a RigidLoad in a scene: rows of all its nodes, with the motions that its conditions allow."""

    KIND: ClassVar[str] = "rigid load"

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
    def label(self) -> str:
        """Name in messages."""
        return f"rigid load {self.surface!r}"


def rigid_face(
    mesh: RootMesh, load: RigidLoad, others: Sequence[str], prescribed: FloatArray, planes: Sequence[PlaneSurface]
) -> RigidFace:
    """The face of a load in a scene.

    Raises SceneError if conditions hold all of it, move it, or hold what the load would move, or if it shares nodes
    with another contact, tie or rigid load.

    Args:
        others: surfaces of contacts, ties and other rigid loads.
        prescribed: (npoints, 3), displacements of the mesh's nodes by conditions [m], NaN where free.
        planes: as from `mirrors.symmetry_planes`.
    """
    facets = mesh.surface(load.surface)
    area = mesh.facet_areas(facets)
    centroid = area @ mesh.facet_points(facets, order=1).mean(axis=1) / area.sum()
    lever = np.zeros(3) if load.point is None else np.array(load.point, dtype=np.float64) - centroid
    nodes = mesh.nodes_of(load.surface)
    for name in others:
        if np.isin(nodes, mesh.nodes_of(name)).any():
            raise SceneError(
                f"{load.what} shares nodes with the surface {name!r} of a contact, tie or rigid load: name facets "
                "away from its rim"
            )
    if np.nan_to_num(prescribed[nodes]).any():
        raise SceneError(f"{load.what} and a condition both move nodes: let them share none, or hold those at 0")
    size = float(np.linalg.norm(mesh.points[nodes] - centroid, axis=1).max())
    motions = rigid_displacements(mesh.points[nodes], centroid, size)
    held = [motions[:, ~np.isnan(prescribed[nodes, axis]), axis] for axis in range(3)]
    for plane in planes:
        on = nodes[np.isin(nodes, mesh.nodes_of(plane.surface))][:1]
        held.append(rigid_displacements(_around(mesh.points[on], plane.normal, size), centroid, size) @ plane.normal)
    all_held = np.concatenate(held, axis=1)
    values, vectors = np.linalg.eigh(all_held @ all_held.T)
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


def _around(points: FloatArray, normal: FloatArray, size: float) -> FloatArray:
    """Points (3 n, 3) of a plane: each of points (n, 3), and two at a distance [m] in its directions.

    A mirrored face stays rigid with its image: displacements across a symmetry plane vanish on all of the plane.
    """
    inside = np.linalg.svd(normal[None])[2][1:]  # two directions in the plane
    return (points[:, None] + size * np.concatenate([np.zeros((1, 3)), inside])).reshape(-1, 3)
