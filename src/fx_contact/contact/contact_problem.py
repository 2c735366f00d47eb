"""The discrete contact problem, and the choices of the user for its solution."""

from collections.abc import Callable
from dataclasses import dataclass

from fx_contact.contact.constraint_rows import ConstraintRows
from fx_contact.contact.enforcement import Enforcement
from fx_contact.contact.initial_guess import RigidModes
from fx_contact.fem.supports import Supports
from fx_contact.fem.volume_term import VolumeTerm
from fx_contact.linalg.linear_solver import LinearSolver
from fx_contact.linalg.matrix import BlockMatrix
from fx_contact.linalg.operator import Array
from fx_contact.linalg.p_multigrid import CoarseLevel
from fx_contact.linalg.petsc_objects import PetscObjects
from fx_contact.linalg.solver_options import Solver
from fx_contact.problem.scene import Scene


@dataclass(frozen=True, eq=False)
class ContactProblem:
    """K u + B^T f = L with f >= 0, B u <= D, f (B u - D) = 0; without contact K u = L.

    Attributes:
        matrix: K on the conforming unknowns, less its `volume` term, made with the same supports, not yet assembled; it
            is used up.
        load: (owned, 3), L [N].
        supports: at the owned conforming nodes.
        energy_norm: omega (4) of a displacement (owned, 3) [m]: [J^(1/2)]; collective.
        rows: B and D; None without contact.
        scene: names the bodies that an active set leaves loose; None: not checked.
        motions: rigid modes of unloaded bodies, which are first moved as a whole; None: they stay.
        coarse: level below the matrix, for p-multigrid; None: there is none.
        volume: part of K that the matrix lacks in nearly incompressible bodies; None: nothing.
    """

    matrix: BlockMatrix
    load: Array
    supports: Supports
    energy_norm: Callable[[Array], float]
    rows: ConstraintRows | None = None
    scene: Scene | None = None
    motions: RigidModes | None = None
    coarse: CoarseLevel | None = None
    volume: VolumeTerm | None = None

    def linear_solver(self, solver: Solver, objects: PetscObjects) -> LinearSolver:
        """The linear solver of K, which uses the matrix up.  Collective on matrix.comm."""
        return LinearSolver(self.matrix, solver, self.energy_norm, objects, self.coarse, self.volume)


@dataclass(frozen=True)
class SolveOptions:
    """Choices of the user.

    Attributes:
        solver: of linear systems.
        enforcement: with which the rows were made.
    """

    solver: Solver
    enforcement: Enforcement = Enforcement()
