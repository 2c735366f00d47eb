"""Status of the tangent rows of one contact: springs, history and forces.

The slip of a load step is d = B_t u - s, s of the load step before (`History`).
"""

from abc import ABC, abstractmethod

import numpy as np

from fx_contact.contact.constraint_rows import ConstraintRows, Role
from fx_contact.contact.contact_system import Springs
from fx_contact.items.friction import TangentialLaw
from fx_contact.parallel.arrays import BoolArray, FloatArray


class TangentialStatus(ABC):
    """Status of the tangent rows of one contact.

    Local.

    Args:
        law: of the contact.
        ours: (n,), the tangents of the contact among all rows.
        history: (n,), s of all rows [m].
    """

    def __init__(self, law: TangentialLaw, rows: ConstraintRows, ours: BoolArray, history: FloatArray) -> None:
        self.law, self.rows, self.ours, self.history = law, rows, ours, history

    @abstractmethod
    def springs(self, active: BoolArray) -> Springs:
        """Springs with shifts of all rows, 0 in those of others, for closed normals among all rows (n,)."""

    def turn(self, direction: FloatArray) -> None:
        """Exchange the directions (n, 3) of our rows by those in which `springs` are."""

    def turn_back(self, force: FloatArray) -> None:
        """Exchange forces (n,) in turned rows by those in t1 and t2."""

    def update(self, force: FloatArray, jump: FloatArray, active: BoolArray, noise: float) -> FloatArray:
        """New status by forces f and jumps B u of all rows (n,), found for closed normals (n,).  Collective.

        Args:
            noise: error of the linear solver in the energy norm [J^(1/2)].

        Returns:
            (3,), the change on this rank: the number of nodes that begin to stick or slip, the sum of
            |change of force|^2 / k_c where nodes slip [J], and the sum of the bounds of the force, negative where
            closed nodes pull: they will open [N].
        """
        return np.zeros(3)

    def slipping(self) -> BoolArray:
        """(n,), normals of ours whose tangents slip with a bounded force."""
        return np.zeros(len(self.rows), dtype=bool)

    def closed(self, active: BoolArray) -> BoolArray:
        """(n,), our tangents in frames with closed normals among all rows (n,)."""
        frame = self.rows.key & ~3
        return self.ours & np.isin(frame, frame[active & (self.rows.role == Role.NORMAL)])


def tangential_vectors(rows: ConstraintRows, values: FloatArray) -> FloatArray:
    """Vectors (n, 3) at the n normals by values of all rows as components along their tangents; 0 without.  Local."""
    normal, tangent = rows.role == Role.NORMAL, rows.role == Role.TANGENT
    result, some = np.zeros((np.count_nonzero(normal), 3)), np.isin(rows.contact[normal], rows.contact[tangent])
    for axis in (1, 2):
        ours = tangent & (rows.axis == axis)
        result[some] += values[ours, None] * rows.normal[ours]
    return result
