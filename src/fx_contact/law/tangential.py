"""Laws of tangents: springs, history and forces of the tangent rows of closed nodes.

The slip of a load step is d = B_t u - s with s = B_t u_0, u_0 the displacement after the load step before.
"""

from abc import ABC, abstractmethod

import numpy as np

from fx_contact.contact.constraint_rows import ConstraintRows, Role
from fx_contact.contact.contact_system import Springs
from fx_contact.items.contact import TangentialLaw
from fx_contact.parallel.arrays import BoolArray, FloatArray
from fx_contact.parallel.errors import SceneError


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

    def closed(self, active: BoolArray) -> BoolArray:
        """(n,), our tangents in frames with closed normals among all rows (n,)."""
        frame = self.rows.key & ~3
        return self.ours & np.isin(frame, frame[active & (self.rows.role == Role.NORMAL)])


#: Status by the type of the law.
STATUS: dict[type[TangentialLaw], type[TangentialStatus]] = {}


def tangential_status(rows: ConstraintRows, before: FloatArray | None) -> list[TangentialStatus]:
    """Status of the tangents of each contact with a tangential law, after a displacement (owned, 3) [m]; None: 0.

    Collective on the prolongation's comm.  Raises SceneError for an unknown law.
    """
    laws = [(kind.index, kind.contact.tangential) for kind in rows.kinds if kind.contact.tangential is not None]
    if not laws:
        return []
    for _, law in laws:
        if type(law) not in STATUS:
            raise SceneError(
                f"there is no status of tangents for a {type(law).__name__}: add one to law.tangential.STATUS"
            )
    history, tangents = np.zeros(len(rows)) if before is None else rows.jump(before), rows.role == Role.TANGENT
    return [STATUS[type(law)](law, rows, tangents & (rows.contact == index), history) for index, law in laws]
