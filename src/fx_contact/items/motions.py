"""Unknown motions t of interfaces along given generalised forces F: of obstacles, bolt sections and rigid faces.

A row with the normal n at x penetrates at the rates w(n, x).  In equilibrium w . f = F for the forces f of the rows.
All is local.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fx_contact.parallel.arrays import FloatArray


class Motion(ABC):
    """Motions t (k,) of one interface."""

    #: The normals, and so the rates, change with the motion.
    TURNS: ClassVar[bool] = False

    @property
    @abstractmethod
    def loads(self) -> FloatArray:
        """(k,), F [N]."""

    @abstractmethod
    def rates(self, normals: FloatArray, positions: FloatArray) -> FloatArray:
        """(k, n), w of rows with normals (n, 3) at positions (n, 3) [m], for n of them [-]."""

    @abstractmethod
    def entry(self, t: FloatArray) -> float | list[float]:
        """The entry in `StepRecord.motions` of t (k,) [m]."""


@dataclass(frozen=True, eq=False)
class Approach(Motion):
    """A rigid obstacle moves along the force on it.

    Attributes:
        against: (3,), unit vector against the force [-].
        force: its length [N].
    """

    TURNS: ClassVar[bool] = True
    against: FloatArray
    force: float

    @property
    def loads(self) -> FloatArray:
        """As `Motion.loads`."""
        return np.array([self.force])

    def rates(self, normals: FloatArray, positions: FloatArray) -> FloatArray:
        """As `Motion.rates`: -n . d along the unit vector d of the force."""
        return np.asarray(normals @ self.against)[None]

    def entry(self, t: FloatArray) -> float:
        """Distance along the force, by which a bolt is shortened [m]."""
        return float(t[0])


class Closing(Approach):
    """The sides of a bolt section are pulled together by a tension: D = t n . e of the row along e.

    Attributes:
        against: minus the axis n, unit vector out of the first side [-].
        force: the tension [N].
    """

    TURNS: ClassVar[bool] = False


@dataclass(frozen=True, eq=False)
class FaceMotion(Motion):
    """A surface moves as a rigid body.

    Rotations are about the centroid, wherever the load's point is: the stiffness of the motions is well conditioned.

    Attributes:
        centroid: of the surface [m].
        lever: (3,), from the centroid to the load's point c [m].
        size: L, of the surface [m].
        basis: (6, k), orthonormal, of the motions (t, L r) of the centroid [m].
        given: (6,), generalised forces (F, M / L) about the centroid [N].
    """

    centroid: FloatArray
    lever: FloatArray
    size: float
    basis: FloatArray
    given: FloatArray

    @property
    def loads(self) -> FloatArray:
        """As `Motion.loads`."""
        return np.asarray(self.basis.T @ self.given)

    def rates(self, normals: FloatArray, positions: FloatArray) -> FloatArray:
        """As `Motion.rates`."""
        displacements = rigid_displacements(positions, self.centroid, self.size)
        return -self.basis.T @ np.einsum("mni,ni->mn", displacements, normals)

    def entry(self, t: FloatArray) -> list[float]:
        """(t, r) of the load's point, six numbers [m], [rad]."""
        shift, turn = (self.basis @ t).reshape(2, 3) / np.array([[1.0], [self.size]])
        return [float(value) for value in (*(shift + np.cross(turn, self.lever)), *turn)]


def rigid_displacements(points: FloatArray, centre: FloatArray, size: float) -> FloatArray:
    """Three translations, and three rotations about a centre by 1 / size, of points (n, 3): (6, n, 3) [-]."""
    translations = np.broadcast_to(np.eye(3)[:, None], (3, len(points), 3))
    return np.concatenate([translations, np.cross(np.eye(3)[:, None], (points - centre) / size)])
