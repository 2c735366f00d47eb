"""The first guess of the displacement, improved before the preconditioner is set up."""

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.linalg import block_diag

from fx_contact.contact.jump import Jump
from fx_contact.contact.penalty_term import PenaltyTerm
from fx_contact.fem.body_motions import UNRESISTED, BodyMotions
from fx_contact.law.unilateral import Unilateral
from fx_contact.linalg.matrix import diagonal_blocks
from fx_contact.linalg.operator import Equations, MatrixOperator
from fx_contact.linalg.petsc_objects import PetscObjects
from fx_contact.parallel.arrays import FloatArray

#: Iterations with block Jacobi before each update of the active set by degree, and most updates
#: (`studies.cost.contact_constants`).
_RELAXATION, _UPDATES = {1: 15, 2: 5}, 5


def move_bodies(
    bodies: BodyMotions, matrix: PETSc.Mat, load: FloatArray, jump: Jump, stiffness: FloatArray, u: FloatArray
) -> FloatArray:
    """Add the rigid motions R a of all bodies that minimise the energy: R^T (K + B^T k B) R a = R^T r.

    A displacement that is 0 at free nodes has the energy of one layer of cells.  For a stiff body on a soft one this
    is a thousand times the energy of the solution, and takes a dozen iterations of PCG.

    Collective on matrix.comm.

    Args:
        matrix: K without penalty.
        load: (owned, 3), right-hand side without contact [N].
        stiffness: (n,), k [N/m].
        u: (owned, 3), displacement so far [m].
    """
    rows, entries = jump.rows, jump.rows.entries
    with PetscObjects() as objects:
        operator = MatrixOperator(matrix, objects)
        force = bodies.sums(Equations(load, PenaltyTerm(jump, stiffness)).residual(operator, u))

    count = len(force)
    across = np.zeros((len(rows), 6 * count))
    moved = rows.bodies[entries.row, entries.side]
    np.add.at(across, entries.row, bodies.rigid.along(rows.position[entries.row], moved, jump.values))
    square = (across.T * stiffness) @ across
    sums = np.concatenate([square, force.reshape(1, -1)])
    rows.prolongation.comm.Allreduce(MPI.IN_PLACE, sums)
    of_cells, diagonal = (block_diag(*one) for one in bodies.resistance(matrix))
    diagonal = np.diagonal(sums[:-1] + diagonal)
    return u + bodies.displacement(_solved(sums[:-1] + of_cells, sums[-1], diagonal).reshape(count, 6))


def _solved(matrix: FloatArray, right_hand_side: FloatArray, diagonal: FloatArray) -> FloatArray:
    """The minimum-norm solution of a symmetric system, scaled by its diagonal before cancellation."""
    scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, np.inf))
    values, vectors = np.linalg.eigh(scale[:, None] * (matrix + matrix.T) / 2 * scale)
    some = values > UNRESISTED
    vectors = scale[:, None] * vectors[:, some]
    return vectors @ ((right_hand_side @ vectors) / values[some])


def relax(
    matrix: PETSc.Mat, load: FloatArray, term: PenaltyTerm, u: FloatArray, status: Unilateral, degree: int
) -> FloatArray:
    """Smooth a displacement from a coarser mesh by PCG with block Jacobi, and update the active set by it.

    Its error has short wavelengths, at the edge of the contact.  The smoothed one mostly has the final active set.

    Collective on matrix.comm.

    Args:
        matrix: with the penalty term of the active set, with which it changes.
        load: (owned, 3), right-hand side without contact [N].
        term: of all rows.
        u: (owned, 3), first guess [m].
        degree: of the displacements.
    """
    with PetscObjects() as objects:
        ksp = objects.add(PETSc.KSP().create(matrix.comm))
        ksp.setType(PETSc.KSP.Type.CG)
        ksp.getPC().setType(PETSc.PC.Type.PBJACOBI)
        ksp.setNormType(PETSc.KSP.NormType.NONE)
        ksp.setInitialGuessNonzero(True)
        ksp.setTolerances(max_it=_RELAXATION[degree])
        x, b = map(objects.add, matrix.createVecs())
        x.array[:] = u.ravel()
        for _ in range(_UPDATES):
            b.array[:] = (load + term.of(status.active).load()).ravel()
            ksp.setOperators(matrix, diagonal_blocks(matrix))
            ksp.solve(b, x)
            u = x.array.reshape(-1, 3).copy()
            before, wanted = status.active, status.wanted(term.forces(u), 0.0)
            if not status.differs(wanted) or status.cycles(wanted):
                break
            status.update(wanted)
            term.of(status.active.astype(float) - before).add_to(matrix)
    return u
