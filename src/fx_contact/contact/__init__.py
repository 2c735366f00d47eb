"""Contact as rows of constraints: kinds of rows, jump, projection, one linear system."""

from typing import Any

from fx_contact.parallel.former import former_names


def _create_node_pairs(scene: Any, _forest: Any, prolongation: Any, enforcement: Any) -> Any:
    from fx_contact.contact.row_kinds import create_rows

    return create_rows(scene, prolongation, enforcement)


_ROWS = "fx_contact.contact.constraint_rows"
__getattr__ = former_names(
    __name__,
    {name: f"{_ROWS}.{name}" for name in ("ConstraintRows", "Entries", "KeyedEntries", "RowColumns", "RowKind")}
    | {name: f"fx_contact.contact.contact_problem.{name}" for name in ("ContactProblem", "SolveOptions")}
    | {name: f"fx_contact.contact.row_kinds.{name}" for name in ("KINDS", "create_rows")}
    | {"Enforcement": "fx_contact.Enforcement", "NodePairs": "fx_contact.contact.node_pairs.NodePairs"}
    | {"create_node_pairs": "create_rows(scene, prolongation, enforcement) of fx_contact.contact.row_kinds"},
    {"create_node_pairs": _create_node_pairs},
)
