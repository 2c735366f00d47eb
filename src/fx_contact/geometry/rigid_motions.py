"""Rigid motions of bodies, three translations and three rotations each, and the constraints on them."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from fx_contact.geometry.hexahedral_mesh import PLANE
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.parallel.arrays import BoolArray, FloatArray, IntArray

#: Eigenvalues of R^T R below this fraction of the largest are rounding errors.
_ROUNDING = 1e-10
#: Names of the six motions, and the part of the largest coefficient from which one is named [-]: a
#: cube that turns about an edge has 0.5 exactly.
_MOTIONS, _SHARE = ("along x", "along y", "along z", "about x", "about y", "about z"), 0.499


class RigidMotions:
    """Rigid motions of the bodies of a root mesh.

    A motion has six coefficients per body [m]: three translations, and three rotations about its middle, measured by
    the displacement at the distance of the body's size.  All is local.

    Args:
        prescribed: (npoints, 3), prescribed displacements of the nodes [m], NaN where free.
        planes: oblique symmetry planes, (nodes, normal (3,)) of each.
        springs: elastic supports, as from `Elastic.resistance`.

    Attributes:
        free: (k, nbodies, 6), orthonormal basis of the motions that the homogeneous conditions and springs allow [-].
        prescribed: (nbodies, 6), the motion closest to the prescribed displacements, 0 at springs [m] (least squares).
    """

    def __init__(
        self,
        mesh: RootMesh,
        prescribed: FloatArray,
        planes: Sequence[tuple[IntArray, FloatArray]] = (),
        springs: Sequence[tuple[FloatArray, IntArray, FloatArray]] = (),
    ) -> None:
        self._mesh = mesh
        body = np.zeros(len(mesh.points), dtype=np.int64)
        body[mesh.corners] = mesh.body[:, None]
        held: list[tuple[FloatArray, IntArray, FloatArray, FloatArray]] = []
        for component in range(3):
            there = np.flatnonzero(~np.isnan(prescribed[:, component]))
            held.append((mesh.points[there], body[there], np.eye(3)[component], prescribed[there, component]))
        held += [(mesh.points[nodes], body[nodes], normal, np.zeros(len(nodes))) for nodes, normal in planes]
        held += [(points, bodies, along, np.zeros(len(points))) for points, bodies, along in springs]
        constraints = np.concatenate([self.along(points, bodies, along) for points, bodies, along, _ in held])
        values = np.concatenate([value for *_, value in held])
        _, strength, motions = np.linalg.svd(constraints.T @ constraints)
        free = strength <= _ROUNDING * max(strength[0], 1e-300)
        fixed = motions[~free]
        motion = ((fixed @ (constraints.T @ values)) / strength[~free]) @ fixed
        self.free = motions[free].reshape(-1, len(mesh.bodies), 6)
        self.prescribed = motion.reshape(-1, 6)

    @cached_property
    def turning(self) -> FloatArray:
        """(nbodies, 3, 3), projectors on the rotations of each body in free motions."""
        _, strength, axes = np.linalg.svd(self.free[:, :, 3:].transpose(1, 0, 2), full_matrices=True)
        axes = axes[:, : strength.shape[1]] * (strength > _ROUNDING)[:, :, None]
        return np.asarray(axes.swapaxes(1, 2) @ axes)

    @property
    def sizes(self) -> FloatArray:
        """(nbodies,), largest extents of the bodies [m]."""
        return self._extents[1][:, 0]

    @cached_property
    def _extents(self) -> tuple[FloatArray, FloatArray]:
        """Middle and size of each body: (nbodies, 3) and (nbodies, 1) [m]."""
        mesh = self._mesh
        corners = [mesh.points[mesh.corners[mesh.body == body]].reshape(-1, 3) for body in range(len(mesh.bodies))]
        low, high = (np.array([end(points, axis=0) for points in corners]) for end in (np.min, np.max))
        return (low + high) / 2, (high - low).max(axis=1, keepdims=True)

    def modes(self, points: FloatArray, bodies: IntArray) -> FloatArray:
        """Displacements for unit coefficients, (n, 6, 3) [-], at points (n, 3) [m] of bodies (n,)."""
        middle, size = self._extents
        rotations = np.cross(np.eye(3), ((points - middle[bodies]) / size[bodies])[:, None])
        return np.concatenate([np.broadcast_to(np.eye(3), rotations.shape), rotations], axis=1)

    def along(self, points: FloatArray, bodies: IntArray, direction: FloatArray) -> FloatArray:
        """Components (n, 6 nbodies) [-] of `modes` in a direction, (3,) or (n, 3); a body of -1 does not move."""
        result = np.zeros((len(points), len(self._mesh.bodies), 6))
        direction = np.broadcast_to(direction, points.shape)
        moved = np.einsum("nmi,ni->nm", self.modes(points, bodies), direction)
        result[np.arange(len(points)), bodies] = np.where(np.asarray(bodies)[:, None] >= 0, moved, 0.0)
        return result.reshape(len(points), 6 * len(self._mesh.bodies))

    def free_along(self, points: FloatArray, bodies: IntArray, direction: FloatArray) -> FloatArray:
        """As `along`, for each of the free motions: (n, k) [-]."""
        return self.along(points, bodies, direction) @ self.free.reshape(-1, 6 * len(self._mesh.bodies)).T

    def unresisted(self, resistance: FloatArray) -> FloatArray:
        """Orthonormal free motions without resistance (l, k + m) [-].

        The resistance (k + m, k + m) is R^T R of all ranks [-]; a row of R is the `free_along` of the first body minus
        that of the second one at a point in contact, and then columns of m motions of obstacles.
        """
        strength, vectors = np.linalg.eigh(resistance)
        # For unit vectors a row of R has a length of about 1.
        return np.asarray(vectors.T[strength <= _ROUNDING * max(strength[-1], 1e-12)])

    def coefficients(self, motions: FloatArray) -> FloatArray:
        """(l, nbodies, 6) [-] of free motions (l, k + m) as from `unresisted`."""
        return np.tensordot(motions[:, : len(self.free)], self.free, axes=1)

    def named(self, motions: FloatArray) -> dict[str, str]:
        """Bodies that move in motions (l, nbodies, 6) [-], by name, and how, as "along x and about z"."""
        moves = np.linalg.norm(motions, axis=0)
        return {
            name: " and ".join(text for text, size in zip(_MOTIONS, row) if size > _SHARE * row.max())
            for name, row in zip(self._mesh.bodies, moves)
            if row.max() > 1e-6  # of unit vectors
        }


def resisting_points(mesh: RootMesh, facets: IntArray, direction: FloatArray, along_normals: BoolArray) -> FloatArray:
    """Points (n, 4, 3) [m] at which facets (n, 2) resist motions in directions (n, 3): their corners.

    Local.  Curved facets where the direction is the normal (n,) have four times the mean of them.
    """
    corners = mesh.facet_points(facets, order=1)
    middle = corners.mean(axis=1, keepdims=True)
    height = np.einsum("nij,nj->ni", mesh.facet_points(facets) - middle, direction)
    curved = np.abs(height).max(axis=1) > PLANE * np.ptp(corners, axis=1).max(axis=1)
    return np.where((curved & along_normals)[:, None, None], middle, corners)
