"""The user's options of the linear solver: preconditioner, tolerances, further options of PETSc."""

from dataclasses import dataclass, field
from typing import Any

from petsc4py import PETSc

from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_count, check_name, check_number, shown

#: PETSc options of the preconditioners, by name; the first is the fastest of those measured.
PRECONDITIONERS: dict[str, dict[str, Any]] = {
    "boomeramg": {
        "pc_type": "hypre",
        "pc_hypre_type": "boomeramg",
        "pc_hypre_boomeramg_numfunctions": 3,
        "pc_hypre_boomeramg_strong_threshold": 0.5,
        "pc_hypre_boomeramg_coarsen_type": "PMIS",
        "pc_hypre_boomeramg_interp_type": "ext+i",
        "pc_hypre_boomeramg_P_max": 4,
        "pc_hypre_boomeramg_agg_nl": 1,
        "pc_hypre_boomeramg_relax_type_all": "Chebyshev",
    },
    "p-multigrid": {
        "pc_type": "mg",
        "pc_mg_levels": 2,
        "pc_use_amat": False,  # the operator may have a stiff penalty term besides
        "mg_levels_ksp_type": "chebyshev",
        "mg_levels_ksp_max_it": 2,
        "mg_levels_pc_type": "pbjacobi",
    },
    "ilu": {
        "pc_type": "hypre",
        "pc_hypre_type": "ilu",
        "pc_hypre_ilu_maxiter": 1,
        "pc_hypre_ilu_tol": 0.0,
        "pc_hypre_ilu_tri_solve": True,
    },
    "boomeramg-robust": {
        "pc_type": "hypre",
        "pc_hypre_type": "boomeramg",
        "pc_hypre_boomeramg_numfunctions": 3,
        "pc_hypre_boomeramg_strong_threshold": 0.25,
        "pc_hypre_boomeramg_relax_type_all": "symmetric-SOR/Jacobi",
    },
    "gamg": {"pc_type": "gamg"},
    "cholesky": {
        "pc_type": "cholesky",
        "pc_factor_mat_solver_type": "mumps",
        "mat_mumps_icntl_14": 80,  # room for delayed pivots [%]
    },
}
#: Algebraic multigrid: PETSc's own where PETSc has no hypre, as in wheels, at up to 1.1 times the CPU seconds.
ALGEBRAIC = "boomeramg" if PETSc.Sys.hasExternalPackage("hypre") else "gamg"
#: Options of p-multigrid where the smoother solves for blocks of nodes.
_BLOCKS = {
    "mg_levels_pc_type": "asm",
    "mg_levels_pc_asm_type": "basic",
    "mg_levels_pc_asm_overlap": 0,
    "mg_levels_sub_pc_type": "lu",
    "mg_levels_sub_pc_factor_mat_ordering_type": "nd",
}
#: Unknowns up to which BoomerAMG coarsens less, as hypre advises for elasticity.  Levels cost nothing there, and
#: aggressive coarsening leaves too few unknowns, 6 of 162, to represent several bodies.
_FEW, _OF_FEW = 10_000, {"pc_hypre_boomeramg_agg_nl": 0, "pc_hypre_boomeramg_strong_threshold": 0.7}
#: Loosest tolerance of a last solve: the error of contact forces is then below 1e-3.  From 1e-2 on it is some per cent,
#: or active sets do not converge, for the energy of the pairs is small.
_LOOSEST = 1e-3


def preconditioner_options(name: str, unknowns: int, blocks: bool = False, factors: bool = False) -> dict[str, Any]:
    """PETSc options, without prefix, of a key of `PRECONDITIONERS` for so many unknowns on all ranks.

    Local.  For p-multigrid: whether the smoother solves for blocks of nodes, and whether Cholesky factors take the
    place of algebraic multigrid below it.
    """
    options = PRECONDITIONERS[name]
    if name == "p-multigrid":
        below = preconditioner_options("cholesky" if factors else ALGEBRAIC, unknowns // 8)
        coarse = {f"mg_coarse_{option}": value for option, value in below.items()}
        return options | (_BLOCKS if blocks else {}) | coarse
    return options | _OF_FEW if name == "boomeramg" and unknowns <= _FEW else options


@dataclass(frozen=True)
class Solver:
    """Options of the linear solver.

    Attributes:
        preconditioner: a key of `PRECONDITIONERS`; None: `ALGEBRAIC` at degree 1, "p-multigrid" at degree 2.
            After a failure Cholesky factors replace it, or for lack of memory "boomeramg-robust".  For nearly
            incompressible bodies at degree 2 it is that of the matrix of the mixed form (`mixed_form`), for FGMRES.
        tolerance: error of the displacement, in the norm of the preconditioned operator, relative to the
            displacement's energy norm omega (4) [-].  That norm weighs penetrations with k_N, so the same tolerance
            holds for any penalty.  The default leaves an error below 1e-7 in the contact force, beside rounding (up to
            2e-4 with factors of thin rubber); the largest tolerance, 1e-3, an error below 1e-3.
        loose_tolerance: the same while the active set changes.
        max_krylov: largest number of iterations of a linear solve with one preconditioner.
        max_contact: largest number of linear solves for an active set; None: no limit.
        options: further PETSc options, without prefix, except tolerances and numbers of iterations; the command line,
            under the prefix `fx_`, overrides them.

    Raises:
        SceneError: an unknown preconditioner, or one of hypre where PETSc has none; a tolerance above 1e-3, or a loose
            one not between it and 1; options that are no dict.
    """

    preconditioner: str | None = None
    tolerance: float = 1e-8
    loose_tolerance: float = 1e-3
    max_krylov: int = 500
    max_contact: int | None = None
    options: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.preconditioner is not None:
            check_name("preconditioner", self.preconditioner, PRECONDITIONERS)
            if PRECONDITIONERS[self.preconditioner]["pc_type"] == "hypre" and ALGEBRAIC == "gamg":
                raise SceneError(f"PETSc has no hypre here, which {self.preconditioner!r} needs: take 'gamg'")
        for name in ("tolerance", "loose_tolerance"):
            object.__setattr__(self, name, check_number(f"the solver's {name}", getattr(self, name), positive=True))
        if self.tolerance > _LOOSEST:
            raise SceneError(
                f"the solver's tolerance must be {_LOOSEST:g} at most, got {self.tolerance!r}: a looser one leaves "
                "contact forces wrong by percents; the error that the mesh may have is the tolerance of adapt"
            )
        if not self.tolerance <= self.loose_tolerance < 1:
            raise SceneError(
                f"loose_tolerance {self.loose_tolerance} must lie between tolerance {self.tolerance} and 1"
            )
        for name in ("max_krylov", "max_contact"):
            if getattr(self, name) is not None or name == "max_krylov":
                check_count(f"the solver's {name}", getattr(self, name))
        if not isinstance(self.options, dict) or not all(isinstance(name, str) for name in self.options):
            raise SceneError(
                f"the solver's options must be a dict of PETSc options by name, got {shown(self.options)}"
            )
