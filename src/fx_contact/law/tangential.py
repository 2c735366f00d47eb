"""Laws of the tangents of contacts."""

from fx_contact.contact.constraint_rows import ConstraintRows, Role
from fx_contact.contact.contact_problem import History
from fx_contact.items.friction import Friction, TangentialLaw
from fx_contact.law.friction import FrictionStatus
from fx_contact.law.tangents import TangentialStatus
from fx_contact.parallel.errors import SceneError

#: Status by the type of the law; a type without an entry has that of its base class.
STATUS: dict[type[TangentialLaw], type[TangentialStatus]] = {Friction: FrictionStatus}


def tangential_status(rows: ConstraintRows, before: History) -> list[TangentialStatus]:
    """Status of the tangents of each contact with a tangential law, after a load step.

    Collective on the prolongation's comm.  Raises SceneError for an unknown law.
    """
    laws = [(kind.index, kind.contact.tangential) for kind in rows.kinds if kind.contact.tangential is not None]
    if not laws:
        return []
    history, tangents = before.jump(rows), rows.role == Role.TANGENT
    return [_status(law)(law, rows, tangents & (rows.contact == index), history) for index, law in laws]


def _status(law: TangentialLaw) -> type[TangentialStatus]:
    """The status of a law.  Raises SceneError: there is none."""
    for kind in type(law).__mro__:
        if kind in STATUS:
            return STATUS[kind]
    raise SceneError(f"there is no status of tangents for a {type(law).__name__}: add one to law.tangential.STATUS")
