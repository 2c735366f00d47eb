"""Rigid motions that neither conditions nor closed rows resist: free ones, and those that a load drives."""

import numpy as np
from petsc4py import PETSc
from scipy.linalg import block_diag
from scipy.sparse.csgraph import connected_components

from fx_contact.fem.body_motions import UNRESISTED, BodyMotions, FreeMotions
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import SolveError

#: Force in a motion, relative to the magnitudes of the loads in it and to the largest resultant on a body in contact,
#: up to which loads are in balance; relative to all, by rounding.  A load through the poles of a ball of 56 cells,
#: whose mean normals are off, drives it sideways by 4e-5; a force is known to the square of the tolerance, 1e-4 at 1 %.
_BALANCED, _NOISE = 1e-4, 1e-12
#: Parts of unit motions that are rounding.
_ROUNDING = 1e-6


class LoadedMotions:
    """Unresisted motions (l, k + m), as from `RigidMotions.unresisted`, and the loads.

    Collective at its making, then local.

    Args:
        load: (owned, 3), without forces of prescribed displacements, which do no work in these motions [N].
        matrix: K, without contact.
        given: (m,), forces that drive m motions of interfaces [N].

    Attributes:
        rigid: the motions of the bodies.
        work: (k + m,), of the loads in unit motions [N].
    """

    def __init__(
        self, bodies: BodyMotions, load: FloatArray, matrix: PETSc.Mat, given: FloatArray = np.zeros(0)
    ) -> None:
        self.rigid = bodies.rigid
        basis = bodies.rigid.free.reshape(len(bodies.rigid.free), -1)
        work, size = bodies.work(load).reshape(2, -1)
        self._bodies, self._basis = bodies, block_diag(basis, np.eye(len(given)))
        self._work, self._size = np.concatenate([work, given]), np.concatenate([size, np.abs(given)])
        self.work = self._basis @ self._work
        none = np.zeros((len(given), len(given)))
        resistance: FloatArray = np.zeros((2, len(bodies.rigid.free[0]), 6, 6))
        if bodies.rigid.turning.any():  # else cells resist none of them
            resistance = bodies.resistance(matrix)
        self._resistance = np.stack([self._basis @ block_diag(*one, none) @ self._basis.T for one in resistance])

    def free(self, motions: FloatArray, joined: FloatArray | None = None) -> FloatArray:
        """The motions, orthonormal, in which the loads do no work.

        Args:
            joined: (nbodies, nbodies), not 0 for bodies in contact; None: there are none.
        """
        of_bodies = motions @ self._basis
        onto = of_bodies.T @ of_bodies  # independent of the basis, which mixes bodies
        force = onto @ self._work
        allowed = _BALANCED * (np.abs(onto) @ self._size) + _NOISE * self._size.max(initial=0.0)
        if joined is not None:
            _, group = connected_components(joined, directed=False)
            largest = np.zeros(len(group))
            np.maximum.at(largest, group, np.abs(self._work[: 6 * len(group)]).reshape(-1, 6).max(axis=1))
            of_interfaces = np.abs(self._work[6 * len(group) :]).max(initial=0.0)
            largest[np.bincount(group, minlength=len(group)) > 1] += of_interfaces
            allowed[: 6 * len(group)] += _BALANCED * np.repeat(largest[group], 6)
        driven = of_bodies @ np.where(np.abs(force) > allowed, force, 0.0)
        return np.asarray(np.linalg.svd(driven[None])[2][1:] @ motions) if driven.any() else motions

    def driven(self, free: FloatArray, motions: FloatArray) -> dict[str, str]:
        """Bodies that move in motions besides free ones, by name, and how."""
        return self.named(_besides(free, motions))

    def motion(self, free: FloatArray, motions: FloatArray) -> tuple[FloatArray, float]:
        """The unit motion (k + m,) besides free ones along which loads do most work, 0 if none, and its length [m].

        The length is that at which cells balance the loads, while free motions do not resist; infinite without.
        """
        rest = _besides(free, motions)
        along = rest.T @ (rest @ self.work)
        force = float(np.linalg.norm(along))
        along /= force or 1.0
        both = np.vstack([along, free])
        energy, diagonal = both @ self._resistance @ both.T
        resistance = energy[0, 0] - energy[0, 1:] @ np.linalg.pinv(energy[1:, 1:], UNRESISTED, True) @ energy[1:, 0]
        return along, force / float(resistance) if resistance > UNRESISTED * diagonal[0, 0] else np.inf

    def named(self, free: FloatArray) -> dict[str, str]:
        """Bodies that move in motions (l, k + m), by name, and how."""
        return self.rigid.named(self.rigid.coefficients(free))

    def left_out(self, free: FloatArray) -> FreeMotions | None:
        """The projector that leaves out free motions, but for those that cells resist; None: there are none.

        Collective.
        """
        energy, diagonal = free @ self._resistance @ free.T
        values, vectors = np.linalg.eigh(energy)
        return self.projector(vectors.T[values <= UNRESISTED * np.diagonal(diagonal).max(initial=0.0)] @ free)

    def projector(self, free: FloatArray) -> FreeMotions | None:
        """The projector that leaves out motions (l, k + m); None: no body moves.  Collective."""
        coefficients = self.rigid.coefficients(free)
        of_bodies = coefficients.reshape(len(free), 6 * coefficients.shape[1])
        _, size, basis = np.linalg.svd(of_bodies, full_matrices=False)
        some = basis[size > _ROUNDING].reshape(-1, *coefficients.shape[1:])
        return FreeMotions(self._bodies, some) if len(some) else None


def _besides(free: FloatArray, motions: FloatArray) -> FloatArray:
    """Orthonormal motions that are orthogonal to free ones."""
    return np.asarray(np.linalg.svd(free @ motions.T)[2][len(free) :] @ motions)


def driven_error(driven: dict[str, str]) -> SolveError:
    """Of bodies, by name and how they move.  Local."""
    bodies = ", ".join(f"{name!r} {ways}" for name, ways in driven.items())
    return SolveError(
        f"nothing holds body {bodies}: a load drives this motion, and no displacement condition, spring or contact "
        "stops it; prescribe displacements that do"
    )
