"""Size of MUMPS' Cholesky factors: predicted from the number of unknowns, or by its analysis."""

from mpi4py import MPI
from petsc4py import PETSc

from fx_contact.linalg.solver_options import PRECONDITIONERS
from fx_contact.parallel.memory import shortage

#: Bytes of the factors of n unknowns over n^(4/3): 240 to 270 in blocks, 80 to 170 in plates
#: (`studies.cost.flat --factors`).
_BYTES = 300
#: Kinds of preconditioner that factorise the matrix.
FACTORISATIONS = (PETSc.PC.Type.CHOLESKY, PETSc.PC.Type.LU)


def predicted_bytes(unknowns: int) -> float:
    """Memory for the factors of a solid body, on all ranks.  Local."""
    return _BYTES * unknowns ** (4 / 3)


def can_be_made(comm: MPI.Intracomm, size: float) -> bool:
    """True if PETSc has MUMPS, and the hosts have so many bytes for all ranks.  Collective on comm."""
    return PETSc.Sys.hasExternalPackage("mumps") and shortage(comm, size / comm.size) is None


def analysed(matrix: PETSc.Mat) -> tuple[float, float]:
    """Bytes of the factors of an SPD AIJ matrix, and of all memory for them, summed over ranks, by MUMPS' analysis.

    Collective on matrix.comm.  Ordering and estimate hardly depend on the number of ranks; the memory grows with it.
    """
    pc = PETSc.PC().create(matrix.comm)
    pc.setOperators(matrix)
    pc.setType(PETSc.PC.Type.CHOLESKY)
    pc.setFactorSolverType("mumps")
    pc.setFactorSetUpSolverType()
    factor = pc.getFactorMatrix()
    factor.setMumpsIcntl(14, PRECONDITIONERS["cholesky"]["mat_mumps_icntl_14"])
    factor.setMumpsIcntl(23, 1)  # memory [MB], too little to go on after the analysis
    pc.setUp()
    entries, megabytes = factor.getMumpsInfog(20), factor.getMumpsInfog(17)
    pc.destroy()
    return 8.0 * (entries if entries >= 0 else -1e6 * entries), 1e6 * megabytes
