"""The ladder of preconditioners: the first one, and its replacements where a Krylov method is slow or fails.

1. The preconditioner of the user, else p-multigrid at degree 2 and BoomerAMG at degree 1.  Below p-multigrid stand
   Cholesky factors of the coarse level if they cost at most `COARSE` iterations, else BoomerAMG.
2. MUMPS' Cholesky factors, once solves since the set-up have taken the iterations that they cost, unless the user has
   chosen a preconditioner.  Whatever PCG still needs, the solves of a set-up cost at most twice the cheaper way.
3. Where the method fails: Cholesky factors if the memory holds them, else a stronger BoomerAMG.

The costs are counts, the same on all ranks and in each run.  An iteration costs as much as `FLOPS` operations of a
factorisation for each entry of the matrix.  MUMPS' analysis counts the operations of the factors.
"""

from dataclasses import dataclass
from math import ceil
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

from fx_contact.linalg.p_multigrid import CoarseLevel
from fx_contact.linalg.solver_options import PRECONDITIONERS, Solver, preconditioner_options
from fx_contact.parallel.memory import shortage

#: Operations of a factorisation in the time of an iteration, for each entry of the matrix: 20 to 73 where a core has
#: the memory to itself, 50 to 150 where others use it too (`studies.cost.flat --factors`).
FLOPS = 60.0
#: Most iterations that factors of the coarse level may cost.  They save 1 to 65 (`studies.cost.distorted`).
COARSE = 5.0
#: Iterations since the set-up before the analysis of factors, which costs about ten, and PCG begins anew.  Bodies that
#: do not bend take 8 to 30 (`studies.cost.flat`).
FIRST_CHECK = 30
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

    Local, but for `fallback`.

    Args:
        entries: of the matrix.
        mixed: pressures are unknowns too.
    """

    def __init__(self, solver: Solver, unknowns: int, entries: int, coarse: CoarseLevel | None, mixed: bool) -> None:
        self._most, self._unknowns = solver.max_krylov, unknowns
        self._flops = FLOPS * entries  # in the time of an iteration
        self.name = solver.preconditioner or ("boomeramg" if coarse is None else "p-multigrid")
        flat = coarse is not None and coarse.blocks is not None
        self._arguments = self.name, unknowns, MIXED_CYCLES if mixed else 1, flat
        self._next: int | None = None
        if solver.preconditioner is None:
            self.check_at(FIRST_CHECK)

    def options(self, coarse_factors: bool) -> dict[str, Any]:
        """PETSc options of the first preconditioner."""
        return preconditioner_options(*self._arguments, coarse_factors)

    def iterations(self, flops: float) -> int:
        """The iterations that a factorisation costs."""
        return ceil(flops / self._flops)

    def limit(self, used: int, before: int) -> int:
        """Largest number of further iterations of a solve after some, and some of solves before since the set-up."""
        most = self._most if self._next is None else min(self._most, self._next - before)
        return max(most - used, 1)

    def due(self, spent: int) -> bool:
        """True if factors are to be weighed after some iterations since the set-up."""
        return self._next is not None and spent >= self._next

    def check_at(self, spent: int | None) -> None:
        """Weigh factors after so many iterations since the set-up; None: no more."""
        self._next = spent

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


@dataclass(frozen=True)
class Factors:
    """Costs of Cholesky factors, summed over ranks, by MUMPS' analysis: operations, bytes of entries, of all memory."""

    flops: float
    entries: float
    memory: float


def analysed(matrix: PETSc.Mat) -> Factors:
    """The costs of factors of an SPD matrix, AIJ or SBAIJ.

    Collective on matrix.comm.  Ordering and counts hardly depend on the number of ranks; the memory grows with it.
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
    flops, entries, megabytes = factor.getMumpsRinfog(1), factor.getMumpsInfog(20), factor.getMumpsInfog(17)
    for thing in (factor, pc):
        thing.destroy()
    return Factors(flops, 8.0 * (entries if entries >= 0 else -1e6 * entries), 1e6 * megabytes)
