"""Contact as rows of constraints: kinds of rows, jump, projection, one linear system."""

import warnings
from typing import Any

from fx_contact.contact.constraint_rows import ConstraintRows, Entries, KeyedEntries, RowColumns, RowKind
from fx_contact.contact.contact_problem import ContactProblem, SolveOptions
from fx_contact.contact.enforcement import Enforcement
from fx_contact.contact.node_pairs import NodePairs
from fx_contact.contact.row_kinds import KINDS, create_rows

__all__ = [
    "KINDS",
    "ConstraintRows",
    "ContactProblem",
    "Enforcement",
    "Entries",
    "KeyedEntries",
    "NodePairs",
    "RowColumns",
    "RowKind",
    "SolveOptions",
    "create_rows",
]


def __getattr__(name: str) -> Any:
    """The former name `create_node_pairs`, with a warning."""
    if name != "create_node_pairs":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    warnings.warn("create_node_pairs is now create_rows", DeprecationWarning, stacklevel=2)
    return lambda scene, _forest, prolongation, enforcement: create_rows(scene, prolongation, enforcement)
