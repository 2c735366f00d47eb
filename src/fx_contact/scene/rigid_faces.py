"""Surfaces of rigid loads in a scene, with the motions that its conditions allow.  All is local."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.items.contact import Contact, Coupling
from fx_contact.items.rigid_loads import RigidLoad
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import SceneError

#: Eigenvalues of R^T R, relative to the largest, and components of loads, that are rounding.
_ROUNDING = 1e-10, 1e-9


@dataclass(frozen=True, eq=False)
class RigidFace(Coupling):
    """The surface of a RigidLoad in a scene, with k motions that its conditions allow: rows of all its nodes.

    Rotations are about the centroid, wherever the load's point is: the stiffness of the motions is well conditioned.

    Attributes:
        surface: name.
        centroid: of the surface [m].
        lever: (3,), from the centroid to the load's point c [m].
        size: L, of the surface [m].
        basis: (6, k), orthonormal, of the motions (t, L r) of the centroid [m].
        given: (6,), generalised forces (F, M / L) about the centroid [N].
        motion: (6,), (t, L r) of the centroid [m].
    """

    surface: str
    centroid: FloatArray
    lever: FloatArray
    size: float
    basis: FloatArray
    given: FloatArray
    motion: FloatArray

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

    @property
    def loads(self) -> FloatArray:
        """(k,), generalised forces along the motions [N]."""
        return np.asarray(self.basis.T @ self.given)

    def rates(self, normals: FloatArray, positions: FloatArray) -> FloatArray:
        """As `Contact.rates`."""
        return -self.basis.T @ np.einsum("mni,ni->mn", _motions(positions, self.centroid, self.size), normals)

    def opening(self, positions: FloatArray) -> FloatArray:
        """As `Contact.opening`: the displacement of the face."""
        return np.asarray(np.einsum("m,mni->ni", self.motion, _motions(positions, self.centroid, self.size)))

    def approached(self, distances: Sequence[float]) -> Self:
        """The face moved on by (t, r) of the load's point, six numbers [m], [rad].  Local."""
        t, r = np.asarray(distances, dtype=np.float64).reshape(2, 3)
        motion = np.concatenate([t - np.cross(r, self.lever), self.size * r])
        return replace(self, motion=self.motion + self.basis @ (self.basis.T @ motion))

    def along(self, distances: FloatArray) -> list[float]:
        """(t, r) of the load's point, six numbers [m], [rad], of k distances [m]."""
        t, r = (self.basis @ distances).reshape(2, 3) / np.array([[1.0], [self.size]])
        return [float(value) for value in (*(t + np.cross(r, self.lever)), *r)]

    def approach_from(self, begin: Contact) -> FloatArray:
        """The k distances since a face of the same place [m].  Local."""
        assert isinstance(begin, RigidFace)
        return np.asarray(self.basis.T @ (self.motion - begin.motion))


def rigid_face(
    mesh: RootMesh,
    load: RigidLoad,
    others: Sequence[str],
    prescribed: FloatArray,
    planes: Sequence[tuple[str, FloatArray]],
) -> RigidFace:
    """The face of a load in a scene.

    Raises SceneError if conditions hold all of it, move it, or hold what the load would move, or if it shares nodes
    with another contact, tie or rigid load.

    Args:
        others: surfaces of contacts, ties and other rigid loads.
        prescribed: (npoints, 3), displacements of the mesh's nodes by conditions [m], NaN where free.
        planes: surfaces on symmetry planes and normals (3,), as from `mirrors.symmetry_planes`.
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
    motions = _motions(mesh.points[nodes], centroid, size)
    held = [motions[:, ~np.isnan(prescribed[nodes, axis]), axis] for axis in range(3)]
    for surface, normal in planes:
        on = nodes[np.isin(nodes, mesh.nodes_of(surface))][:1]
        held.append(_motions(_around(mesh.points[on], normal, size), centroid, size) @ normal)
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
    return RigidFace(load.surface, centroid, lever, size, basis, given, np.zeros(6))


def _around(points: FloatArray, normal: FloatArray, size: float) -> FloatArray:
    """Points (3 n, 3) of a plane: each of points (n, 3), and two at a distance [m] in its directions.

    A mirrored face stays rigid with its image: displacements across a symmetry plane vanish on all of the plane.
    """
    inside = np.linalg.svd(normal[None])[2][1:]  # two directions in the plane
    return (points[:, None] + size * np.concatenate([np.zeros((1, 3)), inside])).reshape(-1, 3)


def _motions(points: FloatArray, centre: FloatArray, size: float) -> FloatArray:
    """Three translations, and three rotations about a centre by 1 / size, of points (n, 3): (6, n, 3) [-]."""
    translations = np.broadcast_to(np.eye(3)[:, None], (3, len(points), 3))
    return np.concatenate([translations, np.cross(np.eye(3)[:, None], (points - centre) / size)])
