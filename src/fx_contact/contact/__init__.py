"""Contact as rows of constraints: node pairs, enforcement, active set, and the solver of the two together."""

from fx_contact.contact.constraint_rows import ConstraintRows
from fx_contact.contact.contact_problem import ContactProblem, SolveOptions
from fx_contact.contact.contact_solver import ContactSolution, solve_contact
from fx_contact.contact.enforcement import Enforcement
from fx_contact.contact.node_pairs import NodePairs, create_node_pairs

__all__ = [
    "ConstraintRows",
    "ContactProblem",
    "ContactSolution",
    "Enforcement",
    "NodePairs",
    "SolveOptions",
    "create_node_pairs",
    "solve_contact",
]
