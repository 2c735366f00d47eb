"""The ladder of preconditioners: the first one, and its replacements where a Krylov method is slow or fails.

1. The preconditioner of the user, else p-multigrid at degree 2 and algebraic multigrid at degree 1.  Below p-multigrid
   stand Cholesky factors of a coarse level of at most `COARSE` unknowns, else algebraic multigrid.
2. MUMPS' Cholesky factors, once a solve has taken `patience` iterations, unless the user has chosen a preconditioner.
3. Where the method fails: Cholesky factors if the memory holds them, else a stronger BoomerAMG if PETSc has hypre.
"""

from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

from fx_contact.linalg.p_multigrid import CoarseLevel
from fx_contact.linalg.solver_options import ALGEBRAIC, Solver, preconditioner_options
from fx_contact.parallel.memory import shortage

#: Most unknowns of a coarse level that is factorised.  At 37,000 the factors of solid bodies take 10 us an unknown and
#: save two of 18 iterations (`demos/hertz.py --tolerance 0.005`); in bodies that bend they save four of five iterations
#: (`studies.cost.distorted`).
COARSE = 30_000
#: Iterations of a solve of n unknowns before Cholesky factors: `PER_SIDE` n^(1/3), at least `FEWEST`.  Bodies that do
#: not bend take up to 43 with 50,000 unknowns; factors cost 7 to 60, more and more where there are more unknowns
#: (`studies.cost.flat`).
FEWEST, PER_SIDE = 30, 1.2
#: Replacements of a preconditioner that fails: the first if there is memory for its factors, else the second.
FALLBACKS = ("cholesky", "boomeramg-robust")
#: Bytes of the factors of n unknowns over n^(4/3): 240 to 270 in blocks, 80 to 170 in plates
#: (`studies.cost.flat --factors`).
_BYTES = 300
#: Kinds of preconditioner that factorise the matrix.
FACTORISATIONS = (PETSc.PC.Type.CHOLESKY, PETSc.PC.Type.LU)


def first_name(solver: Solver, coarse: CoarseLevel | None) -> str:
    """The key of `PRECONDITIONERS` of the first one.  Local."""
    return solver.preconditioner or (ALGEBRAIC if coarse is None else "p-multigrid")


def first_options(
    comm: MPI.Intracomm, name: str, unknowns: int, coarse: CoarseLevel | None, of_user: dict[str, Any]
) -> dict[str, Any]:
    """PETSc options of the first preconditioner.  Those of the user for the coarse level keep BoomerAMG there.

    Collective on comm.
    """
    size = 0 if coarse is None else coarse.matrix.getSize()[0]
    chosen = any(option.startswith("mg_coarse") for option in of_user)
    factors = 0 < size <= COARSE and not chosen and can_be_made(comm, size)
    return preconditioner_options(name, unknowns, coarse is not None and coarse.blocks is not None, factors)


def patience(solver: Solver, unknowns: int, of_user: dict[str, Any]) -> int | None:
    """Iterations of a solve after which factors take over; None: the user has chosen or allows no more.  Local."""
    most = max(FEWEST, round(PER_SIDE * unknowns ** (1 / 3)))
    chosen = solver.preconditioner is not None or "pc_type" in of_user
    return None if chosen or most >= solver.max_krylov else most


def fallback(comm: MPI.Intracomm, unknowns: int, present: str) -> str | None:
    """The preconditioner that replaces the present one where it fails; None: there is none.  Collective on comm."""
    robust = FALLBACKS[1] if ALGEBRAIC == "boomeramg" else None
    name = FALLBACKS[0] if can_be_made(comm, unknowns) else robust
    return None if present in (FALLBACKS[0], name) else name


def predicted_bytes(unknowns: int) -> float:
    """Memory for the factors of a solid body, on all ranks.  Local."""
    return _BYTES * unknowns ** (4 / 3)


def can_be_made(comm: MPI.Intracomm, unknowns: int) -> bool:
    """True if PETSc has MUMPS, and the hosts have memory for factors of so many unknowns.  Collective on comm."""
    return PETSc.Sys.hasExternalPackage("mumps") and shortage(comm, predicted_bytes(unknowns) / comm.size) is None
