"""The discrete contact problem, and the user's options for its solution."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from fx_contact.contact.constraint_rows import ConstraintRows
from fx_contact.contact.enforcement import Enforcement
from fx_contact.fem.body_motions import BodyMotions
from fx_contact.fem.supports import Supports
from fx_contact.fem.volume_term import VolumeTerm
from fx_contact.linalg.linear_solver import LinearSolver, suited
from fx_contact.linalg.matrix import BlockMatrix
from fx_contact.linalg.p_multigrid import CoarseLevel
from fx_contact.linalg.petsc_objects import PetscObjects
from fx_contact.linalg.solver_options import Solver
from fx_contact.linalg.stopping import EnergyNorm
from fx_contact.parallel.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class History:
    """The load step before.

    Attributes:
        displacement: (owned, 3); None: 0 [m].
        moved: `Contact.moved` by the names of contacts; others: 0 [m].
    """

    displacement: FloatArray | None = None
    moved: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)

    def jump(self, rows: ConstraintRows) -> FloatArray:
        """s (n,) [m] of rows: B u of that displacement, and how far obstacles have moved since then.  Collective."""
        result: FloatArray = np.zeros(len(rows)) if self.displacement is None else rows.jump(self.displacement)
        for kind in rows.kinds:
            way = np.subtract(kind.contact.moved, self.moved.get(kind.contact.name, np.zeros(3)))
            result += np.where(rows.contact == kind.index, rows.normal @ way, 0.0)
        return result


@dataclass(frozen=True, eq=False)
class ContactProblem:
    """K u + B^T f = L with f >= 0, B u <= D, f (B u - D) = 0; in rows of ties B u = 0; without rows K u = L.

    Attributes:
        matrix: K without `volume`, made with the same supports, not yet assembled; the solution frees it.
        load: (owned, 3), L [N].
        supports: at the owned conforming nodes.
        energy_norm: omega (4).
        rows: B and D; None: neither contact nor ties.
        bodies: to move into contact, and to find unresisted motions of an active set; None: neither.
        coarse: level below the matrix, for p-multigrid.
        volume: term of nearly incompressible bodies beside the matrix.
        before: the load step before, from which tangents slip.
        rows_at: the rows for distances (k,) of obstacles along the forces on them [m]; collective.  None: there are no
            such obstacles.
        distances: (k,), where they begin [m].
    """

    matrix: BlockMatrix
    load: FloatArray
    supports: Supports
    energy_norm: EnergyNorm
    rows: ConstraintRows | None = None
    bodies: BodyMotions | None = None
    coarse: CoarseLevel | None = None
    volume: VolumeTerm | None = None
    before: History = field(default_factory=History)
    rows_at: Callable[[FloatArray], ConstraintRows] | None = None
    distances: FloatArray = field(default_factory=lambda: np.zeros(0))

    def linear_solver(self, solver: Solver, objects: PetscObjects) -> LinearSolver:
        """LinearSolver of K, which owns the matrix.  Collective on matrix.comm.  Raises errors as `LinearSolver`."""
        matrix = suited(self.matrix, solver, self.coarse)
        objects.add(matrix.mat)
        return LinearSolver(matrix, solver, self.energy_norm, objects, self.coarse, self.volume)


@dataclass(frozen=True)
class SolveOptions:
    """The user's options for linear systems, and the enforcement with which the rows were made."""

    solver: Solver
    enforcement: Enforcement = Enforcement()
