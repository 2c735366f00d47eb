"""The ladder of preconditioners: the first one, and its replacements where a Krylov method is slow or fails.

1. The preconditioner of the user, else p-multigrid at degree 2 and BoomerAMG at degree 1.
2. MUMPS' Cholesky factors, if they are small and the user has chosen no preconditioner: `FACTORISATION_CHECKS`.
3. Where the method fails: Cholesky factors if the memory holds them, else a stronger BoomerAMG.
"""

from mpi4py import MPI
from petsc4py import PETSc

from fx_contact.linalg.p_multigrid import CoarseLevel
from fx_contact.linalg.solver_options import PRECONDITIONERS, Solver, preconditioner_options
from fx_contact.parallel.memory import shortage

#: (iterations of one solve, bytes per unknown) at which Cholesky factors take over if their entries need no more.
#: Factors of 4.5 to 5 kB cost the time of 300 to 400 iterations.  In bending PCG takes 400 to more than 2000; on flat
#: cells without bending PCG takes 7 to 14, FGMRES 19 to 48 (`studies.cost.preconditioners`, `studies.cost.flat`).
FACTORISATION_CHECKS = {"default": ((50, 4.5e3), (200, 6e3)), "flat cells": ((30, 4.5e3), (200, 6e3))}
#: Replacements of a preconditioner that fails: the first if there is memory for its factors, else the second.
FALLBACKS = ("cholesky", "boomeramg-robust")
#: Cycles of BoomerAMG below p-multigrid in the mixed form: 4 to 8 iterations less than with one, 12 to 18 % less time
#: (`studies.incompressible.run --cycles`).
MIXED_CYCLES = 3

#: Bytes of the factors of n unknowns over n^(4/3): 240 to 270 in blocks, 80 to 170 in plates
#: (`studies.cost.flat --factors`).
_BYTES = 300
#: Kinds of preconditioner that factorise the matrix.
FACTORISATIONS = (PETSc.PC.Type.CHOLESKY, PETSc.PC.Type.LU)


class Ladder:
    """The preconditioners of one linear solver: at first `name`, a key of `PRECONDITIONERS`, with PETSc `options`.

    Local, but for `fallback`.  `mixed`: pressures are unknowns too.
    """

    def __init__(self, solver: Solver, unknowns: int, coarse: CoarseLevel | None, mixed: bool) -> None:
        self._most, self._unknowns = solver.max_krylov, unknowns
        self.name = solver.preconditioner or ("boomeramg" if coarse is None else "p-multigrid")
        flat = coarse is not None and coarse.blocks is not None
        self.options = preconditioner_options(self.name, unknowns, MIXED_CYCLES if mixed else 1, flat)
        checks = FACTORISATION_CHECKS["flat cells" if flat and not mixed else "default"]
        chosen = solver.preconditioner is not None
        self._checks = [] if chosen else [check for check in checks if check[0] < self._most]

    def limit(self, used: int) -> int:
        """Largest number of further iterations of a solve after some with the present preconditioner."""
        return max((self._checks[0][0] if self._checks else self._most) - used, 1)

    def due(self, used: int) -> float | None:
        """Bytes that factors may take after some iterations; None: no check is due.  Each is made once."""
        return self._checks.pop(0)[1] * self._unknowns if self._checks and used >= self._checks[0][0] else None

    def end_checks(self) -> None:
        """Make no more checks."""
        self._checks = []

    def fallback(self, comm: MPI.Intracomm, present: str) -> str | None:
        """The preconditioner that replaces the present one where it fails; None: there is none.  Collective on comm."""
        name = FALLBACKS[0 if can_be_made(comm, predicted_bytes(self._unknowns)) else 1]
        return None if present in (FALLBACKS[0], name) else name


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
