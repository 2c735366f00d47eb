"""Laws of rows, their status, and the solvers of the contact problem."""
