"""The coarse level of p-multigrid: its matrix, with the springs of closed contact, and the interpolation from it."""


class CoarseLevel:
    """A coarse matrix K_c and the interpolation I from its unknowns; with springs K_c + (B I)^T k B I.

    Collective.

    Args:
        comm: MPI communicator of the run.
        matrix: PETSc AIJ matrix K_c, without springs.
        interpolation: PETSc AIJ matrix I, fine unknowns by coarse ones.

    Attributes:
        interpolation: as given.
        matrix: PETSc Mat with the present springs.
    """

    def __init__(self, comm, matrix, interpolation):
        self.comm, self._bare, self.interpolation = comm, matrix, interpolation
        self.matrix, self._rows = matrix, None

    def couple(self, rows):
        """Let springs act across some rows from now on; at first they have none.

        Args:
            rows: PETSc AIJ matrix B, rows by fine unknowns; it is used up.
        """
        self._rows = rows.matMult(self.interpolation)
        rows.destroy()

    def stiffen(self, stiffness):
        """The matrix for other springs.

        Args:
            stiffness: (n,) float64, k of this rank's rows [N/m].
        """
        self._drop()
        scaled, scale = self._rows.copy(), self._rows.createVecLeft()
        scale.array[:] = stiffness
        scaled.diagonalScale(L=scale)
        springs = self._rows.transposeMatMult(scaled)
        self.matrix = self._bare.copy()
        self.matrix.axpy(1.0, springs)
        for thing in (scaled, scale, springs):
            thing.destroy()

    def _drop(self):
        if self.matrix is not self._bare:
            self.matrix.destroy()

    def destroy(self):
        """Free what PETSc holds."""
        self._drop()
        for thing in (self._bare, self.interpolation, self._rows):
            if thing is not None:
                thing.destroy()
