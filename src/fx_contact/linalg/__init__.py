"""PETSc: the matrix on the conforming unknowns, operators, preconditioners, Krylov methods."""
