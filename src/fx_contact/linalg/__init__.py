"""PETSc: the matrix on the conforming unknowns, preconditioners, conjugate gradients."""
