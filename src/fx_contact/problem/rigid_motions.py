"""Rigid motions of bodies: three translations and three rotations of each, and which of them conditions stop."""

from functools import cached_property

import numpy as np

#: Singular values of R^T R below this part of the largest are rounding.
_ROUNDING = 1e-10


class RigidMotions:
    """Rigid motions of the bodies of a root mesh.

    Local.  A motion has six coefficients a body [m]: three translations, and three rotations about its middle, each the
    displacement at the distance of its size.

    Args:
        mesh: RootMesh.
        prescribed: (npoints, 3) float64, prescribed displacements of its nodes [m], NaN where free.
        planes: oblique planes of symmetry, (nodes, normal (3,)) of each.

    Attributes:
        free: (k, nbodies, 6) float64, coefficients [-] of an orthonormal basis of the motions that homogeneous
            conditions allow.
        prescribed: (nbodies, 6) float64, coefficients [m] of the motion closest to the prescribed displacements (least
            squares).
    """

    def __init__(self, mesh, prescribed, planes=()):
        self._mesh = mesh
        body = np.zeros(len(mesh.points), dtype=np.int64)
        body[mesh.corners] = mesh.body[:, None]
        rows, values = [np.zeros((1, 6 * len(mesh.bodies)))], [np.zeros(1)]
        for component, direction in enumerate(np.eye(3)):
            nodes = np.flatnonzero(~np.isnan(prescribed[:, component]))
            rows.append(self.along(mesh.points[nodes], body[nodes], direction))
            values.append(prescribed[nodes, component])
        for nodes, normal in planes:
            rows.append(self.along(mesh.points[nodes], body[nodes], normal))
            values.append(np.zeros(len(nodes)))
        held = np.concatenate(rows)
        _, strength, motions = np.linalg.svd(held.T @ held)
        free = strength <= _ROUNDING * max(strength[0], 1e-300)
        stopped = motions[~free]
        motion = ((stopped @ (held.T @ np.concatenate(values))) / strength[~free]) @ stopped
        self.free = motions[free].reshape(-1, len(mesh.bodies), 6)
        self.prescribed = motion.reshape(-1, 6)

    @cached_property
    def _extents(self):
        """Middle and size of each body: (nbodies, 3) and (nbodies, 1) float64 [m]."""
        mesh = self._mesh
        corners = [mesh.points[mesh.corners[mesh.body == body]].reshape(-1, 3) for body in range(len(mesh.bodies))]
        low, high = (np.array([end(points, axis=0) for points in corners]) for end in (np.min, np.max))
        return (low + high) / 2, (high - low).max(axis=1, keepdims=True)

    def modes(self, points, bodies):
        """Displacements at points for unit coefficients.

        Local.

        Args:
            points: (n, 3) float64 [m].
            bodies: (n,) int, the body of each.

        Returns:
            (n, 6, 3) float64 [-].
        """
        middle, size = self._extents
        rotations = np.cross(np.eye(3), ((points - middle[bodies]) / size[bodies])[:, None])
        return np.concatenate([np.broadcast_to(np.eye(3), rotations.shape), rotations], axis=1)

    def along(self, points, bodies, direction):
        """Displacements along a direction at points, for each coefficient of each body.

        Local.

        Args:
            points, bodies: as in `modes`; a body of -1 does not move.
            direction: (3,) or (n, 3) float64 [-].

        Returns:
            (n, 6 nbodies) float64 [-].
        """
        result = np.zeros((len(points), len(self._mesh.bodies), 6))
        direction = np.broadcast_to(direction, points.shape)
        moved = np.einsum("nmi,ni->nm", self.modes(points, bodies), direction)
        result[np.arange(len(points)), bodies] = np.where(np.asarray(bodies)[:, None] >= 0, moved, 0.0)
        return result.reshape(len(points), 6 * len(self._mesh.bodies))

    def free_along(self, points, bodies, direction):
        """Displacements along a direction at points, for each of the free motions.

        Local.

        Args:
            points, bodies, direction: as in `along`.

        Returns:
            (n, k) float64 [-].
        """
        return self.along(points, bodies, direction) @ self._free_rows.T

    @property
    def _free_rows(self):
        """`free` as a matrix: (k, 6 nbodies)."""
        return self.free.reshape(-1, 6 * len(self._mesh.bodies))

    def unresisted(self, resistance):
        """Bodies that move in a free motion that nothing resists.

        Local.

        Args:
            resistance: (k, k) float64, R^T R of all ranks [-]; the rows of R are what `free_along` gives for the first
                body at points in contact less what it gives for the second one.

        Returns:
            list of str, their names.
        """
        if not len(self.free):
            return []
        strength, vectors = np.linalg.eigh(resistance)
        # Of unit vectors: a row of R has a length of about 1, a motion that a body takes part in at least 1e-6.
        loose = vectors.T[strength <= _ROUNDING * max(strength[-1], 1e-12)]
        moves = (np.abs(loose @ self._free_rows) > 1e-6).reshape(-1, *self.free.shape[1:]).any(axis=(0, 2))
        return [name for name, free in zip(self._mesh.bodies, moves) if free]
