"""PETSc: the matrix on the conforming unknowns, preconditioners, conjugate gradients."""

from fx_contact.linalg.conjugate_gradients import ConjugateGradients
from fx_contact.linalg.matrix import BlockMatrix
from fx_contact.linalg.solver_options import Solver

__all__ = ["BlockMatrix", "ConjugateGradients", "Solver"]
