"""The first guess of the displacement, improved before the preconditioner is set up."""

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fx_contact.contact.penalty_term import PenaltyTerm
from fx_contact.linalg.petsc_objects import PetscObjects

#: Eigenvalues of the rigid motions' energy, relative to its diagonal, up to which they are the rounding of 0.
_UNRESISTED = 1e-12
#: Iterations with block Jacobi before the active set is updated, and most updates.  Measured by
#: studies/cost/contact_constants.py, iterations with hypre for 0 x 0, 5 x 5, 15 x 1, 15 x 5, 45 x 5: 238, 181, 185,
#: 176, 173.
_RELAXATION, _UPDATES = 15, 5


class RigidModes:
    """The rigid modes R of all bodies at the conforming nodes, for a first guess of bodies without displacement.

    Where displacements are prescribed, zero elsewhere has all its energy in one layer of cells: for a stiff body on a
    soft one a thousand times that of the solution, which costs PCG a dozen iterations.

    Local.

    Args:
        scene: Scene.
        forest: Forest.
        prolongation: Prolongation of the forest.
    """

    def __init__(self, scene, forest, prolongation):
        self._scene, self._comm = scene, forest.comm
        space = prolongation.space
        self._body = prolongation.injected(scene.mesh.body[forest.cell[space.example[:, 0]]].astype(np.int64))
        positions = prolongation.injected(space.positions())
        self._modes = np.ascontiguousarray(scene.rigid_motions.modes(positions, self._body).swapaxes(0, 1))

    def move(self, matrix, base, jump, stiffness, u, supports):
        """Add the rigid motions R a of all bodies that minimise the energy: R^T (K + B^T k B) R a = R^T r.

        Collective on matrix.comm.

        Args:
            matrix: PETSc Mat, K without penalty.
            base: (owned, 3) float64, right-hand side without contact [N].
            jump: Jump.
            stiffness: (n,) float64, k [N/m].
            u: (owned, 3) float64, the displacement so far [m].
            supports: Supports at the owned conforming nodes.

        Returns:
            (owned, 3) float64 [m].
        """
        rows, bodies = jump.rows, len(self._scene.mesh.bodies)
        modes = np.stack([supports.free_part(mode) for mode in self._modes])
        with PetscObjects() as objects:
            x, y = map(objects.add, matrix.createVecs())

            def product(values):
                """The matrix times a displacement, both (owned, 3); overwritten by the next."""
                x.array[:] = values.ravel()
                matrix.mult(x, y)
                return y.array.reshape(-1, 3)

            penalty = np.zeros_like(u)
            PenaltyTerm(jump, stiffness).add_force(u, penalty)
            force = self._of_bodies(modes, base - product(u) - penalty)
            # K does not couple bodies, so that six products are enough for all of them.
            stiff = np.stack([self._of_bodies(modes, product(mode)) for mode in modes], axis=2)
            matrix.getDiagonal(x)
            diagonal = self._of_bodies(modes**2, x.array.reshape(-1, 3))

        gram = np.zeros((bodies, 6, bodies, 6))
        gram[np.arange(bodies), :, np.arange(bodies)] = stiff
        row, body = jump.blocks.row, rows.bodies[jump.blocks.row, jump.blocks.side]
        across = np.zeros((len(rows), 6 * bodies))
        np.add.at(across, row, self._scene.rigid_motions.along(rows.position[row], body, jump.blocks.values))
        gram = gram.reshape(6 * bodies, -1) + (across.T * stiffness) @ across
        diagonal = diagonal.ravel() + stiffness @ across**2
        sums = np.concatenate([gram, force.reshape(1, -1), diagonal[None]])
        self._comm.Allreduce(MPI.IN_PLACE, sums)
        motion = _solved(sums[:-2], sums[-2], sums[-1]).reshape(bodies, 6)
        return u + np.einsum("nm,mni->ni", motion[self._body], modes)

    def _of_bodies(self, modes, values):
        """This rank's sums over each body of modes times values, both (owned, 3): (nbodies, 6)."""
        work = [np.einsum("ni,ni->n", mode, values) for mode in modes]
        bodies = len(self._scene.mesh.bodies)
        return np.stack([np.bincount(self._body, one, minlength=bodies) for one in work], axis=1)


def _solved(matrix, right_hand_side, diagonal):
    """The least solution of a symmetric system, scaled by its diagonal before anything cancelled."""
    scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, np.inf))
    values, vectors = np.linalg.eigh(scale[:, None] * (matrix + matrix.T) / 2 * scale)
    some = values > _UNRESISTED
    vectors = scale[:, None] * vectors[:, some]
    return vectors @ ((right_hand_side @ vectors) / values[some])


def relax(matrix, base, term, u, status):
    """Smooth a displacement carried from a coarser mesh by PCG with block Jacobi, and update the active set by it.

    Its error is of short waves, at the edge of the contact.  Smoothed, it has mostly the final active set, for which
    hypre is then set up once.  From zero displacement a few iterations would not reach the contact.

    Collective on matrix.comm.

    Args:
        matrix: PETSc Mat with the penalty term of the active set; changed as that is.
        base: (owned, 3) float64, right-hand side without contact [N].
        term: PenaltyTerm of all rows.
        u: (owned, 3) float64, first guess [m].
        status: ActiveSet, changed.

    Returns:
        (owned, 3) float64 [m].
    """
    with PetscObjects() as objects:
        ksp = objects.add(PETSc.KSP().create(matrix.comm))
        ksp.setType(PETSc.KSP.Type.CG)
        ksp.getPC().setType(PETSc.PC.Type.PBJACOBI)
        ksp.setNormType(PETSc.KSP.NormType.NONE)
        ksp.setInitialGuessNonzero(True)
        ksp.setTolerances(max_it=_RELAXATION)
        x, b = map(objects.add, matrix.createVecs())
        x.array[:] = u.ravel()
        for _ in range(_UPDATES):
            b.array[:] = (base + term.of(status.active).load()).ravel()
            ksp.setOperators(matrix)
            ksp.solve(b, x)
            u = x.array.reshape(-1, 3).copy()
            before, wanted = status.active, status.wanted(term.forces(u), 0.0)
            if not status.differs(wanted) or status.cycles(wanted):
                break
            status.update(wanted)
            term.of(status.active.astype(float) - before).add_to(matrix)
    return u
