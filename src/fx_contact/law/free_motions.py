"""Rigid motions that neither conditions nor closed rows resist: free ones, and those that a load drives."""

import numpy as np

from fx_contact.fem.body_motions import BodyMotions, FreeMotions
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import SolveError

#: Work of the loads in a motion, relative to the sum of its parts' magnitudes, up to which they are in balance: more
#: than rounding and the quadrature of moments on curved surfaces, less than any force that matters.
_BALANCED = 1e-6
#: Parts of unit motions that are rounding.
_ROUNDING = 1e-6


class LoadedMotions:
    """Unresisted motions (l, k + m), as from `RigidMotions.unresisted`, and the loads.

    Collective at its making, then local.

    Args:
        load: (owned, 3) [N].
        given: (m,), forces that drive m motions of interfaces [N].
    """

    def __init__(self, bodies: BodyMotions, load: FloatArray, given: FloatArray = np.zeros(0)) -> None:
        self._bodies, basis = bodies, bodies.rigid.free.reshape(len(bodies.rigid.free), -1)
        work, size = bodies.work(load).reshape(2, -1)
        self._work = np.concatenate([basis @ work, given])
        self._size = np.concatenate([np.abs(basis) @ size, np.abs(given)])

    def free(self, motions: FloatArray) -> FloatArray:
        """The motions, orthonormal, in which the loads do no work."""
        work = motions @ self._work
        if (np.abs(work) <= _BALANCED * (np.abs(motions) @ self._size)).all():
            return motions
        return np.asarray(np.linalg.svd(work[None])[2][1:] @ motions)

    def driven(self, free: FloatArray, motions: FloatArray) -> dict[str, str]:
        """Bodies that move in motions besides free ones, by name, and how."""
        rest = np.linalg.svd(free @ motions.T)[2][len(free) :] @ motions
        return self._bodies.rigid.named(self._bodies.rigid.coefficients(rest))

    def left_out(self, free: FloatArray) -> FreeMotions | None:
        """The projector that leaves free motions out; None: there are none.  Collective."""
        coefficients = self._bodies.rigid.coefficients(free)
        _, size, basis = np.linalg.svd(
            coefficients.reshape(len(free), 6 * coefficients.shape[1]), full_matrices=False
        )
        some = basis[size > _ROUNDING].reshape(-1, *coefficients.shape[1:])
        return FreeMotions(self._bodies, some) if len(some) else None


def driven_error(driven: dict[str, str]) -> SolveError:
    """Of bodies, by name and how they move.  Local."""
    bodies = ", ".join(f"{name!r} {ways}" for name, ways in driven.items())
    return SolveError(
        f"nothing holds body {bodies}: a load drives this motion, and no displacement condition, spring or contact "
        "stops it; prescribe displacements that do"
    )
