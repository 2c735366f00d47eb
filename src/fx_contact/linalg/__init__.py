"""PETSc: the matrix on the conforming unknowns, operators, preconditioners, Krylov methods."""

from fx_contact.linalg.linear_solver import LinearSolver
from fx_contact.linalg.matrix import BlockMatrix
from fx_contact.linalg.operator import Equations, Operator
from fx_contact.linalg.solver_options import Solver

__all__ = ["BlockMatrix", "Equations", "LinearSolver", "Operator", "Solver"]
