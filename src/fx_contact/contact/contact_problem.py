"""What is solved, how, and where its costs and objects go."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fx_contact.contact.constraint_rows import ConstraintRows
from fx_contact.contact.enforcement import Enforcement
from fx_contact.contact.initial_guess import RigidModes
from fx_contact.fem.supports import Supports
from fx_contact.fem.volume_term import VolumeTerm
from fx_contact.linalg.conjugate_gradients import ConjugateGradients
from fx_contact.linalg.matrix import BlockMatrix
from fx_contact.linalg.mixed_solver import MixedSolver
from fx_contact.linalg.p_multigrid import CoarseLevel
from fx_contact.linalg.petsc_objects import PetscObjects
from fx_contact.linalg.solver_options import Solver
from fx_contact.parallel.timing import Stages
from fx_contact.problem.scene import Scene


@dataclass(frozen=True, eq=False)
class ContactProblem:
    """K u + B^T f = L with f >= 0, B u <= D, f (B u - D) = 0; without contact K u = L.

    Attributes:
        matrix: BlockMatrix, K on the conforming unknowns, or A with a `volume`, made with the same supports, not yet
            assembled; it is used up.
        load: (owned, 3) float64, L [N].
        supports: Supports at the owned conforming nodes.
        energy_norm: function of a displacement (owned, 3) float64 [m]: its energy norm omega (4) [J^(1/2)]; collective.
        rows: ConstraintRows, B and D; None without contact.
        scene: Scene, to name the bodies that an active set leaves loose; None: not checked.
        motions: RigidModes of unloaded bodies, which are first moved as a whole; None: they stay.
        coarse: CoarseLevel below the matrix, for p-multigrid; None: there is none.
        volume: VolumeTerm, what the matrix lacks of K in nearly incompressible bodies; None: nothing.
    """

    matrix: BlockMatrix
    load: np.ndarray
    supports: Supports
    energy_norm: Callable[[np.ndarray], float]
    rows: ConstraintRows | None = None
    scene: Scene | None = None
    motions: RigidModes | None = None
    coarse: CoarseLevel | None = None
    volume: VolumeTerm | None = None

    def linear_solver(self, solver, objects):
        """What solves with the matrix, which it uses up: ConjugateGradients, or MixedSolver.

        Collective on matrix.comm.

        Args:
            solver: Solver.
            objects: PetscObjects, with which it is freed.
        """
        arguments = solver, self.energy_norm, objects, self.coarse
        if self.volume is None:
            return ConjugateGradients(self.matrix, *arguments)
        return MixedSolver(self.matrix, self.volume, *arguments)


@dataclass(frozen=True)
class SolveOptions:
    """How it is solved.

    Attributes:
        solver: Solver.
        enforcement: Enforcement, with which the rows were made.
    """

    solver: Solver
    enforcement: Enforcement = Enforcement()


@dataclass(frozen=True, eq=False)
class Environment:
    """Where costs and objects go.

    Attributes:
        stages: Stages, for the times.
        objects: PetscObjects, with which the system is freed.
    """

    stages: Stages
    objects: PetscObjects
