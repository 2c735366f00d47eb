"""Laws of rows, their status, and the solvers of the contact problem."""

from fx_contact.law.contact_solver import ContactSolution, solve_contact

__all__ = ["ContactSolution", "solve_contact"]
