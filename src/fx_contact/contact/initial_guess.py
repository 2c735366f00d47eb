"""The first guess of the displacement, improved before the preconditioner is set up."""

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fx_contact.contact.active_set import ActiveSet
from fx_contact.contact.jump import Jump
from fx_contact.contact.penalty_term import PenaltyTerm
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.supports import Supports
from fx_contact.forest.forest import Forest
from fx_contact.linalg.petsc_objects import PetscObjects
from fx_contact.parallel.arrays import FloatArray
from fx_contact.problem.scene import Scene

#: Eigenvalues of the rigid motions' energy, relative to its diagonal, up to which they are the rounding of 0.
_UNRESISTED = 1e-12
#: Iterations with block Jacobi before the active set is updated, and most updates.  Measured by
#: studies/cost/contact_constants.py, iterations with hypre for 0 x 0, 5 x 5, 15 x 1, 15 x 5, 45 x 5: 238, 181, 185,
#: 176, 173.
_RELAXATION, _UPDATES = 15, 5


class RigidModes:
    """The rigid modes R of all bodies at the conforming nodes, for a first guess of bodies without displacement.

    If a first guess is 0 where nothing is prescribed, its energy is that of one layer of cells: for a stiff body on a
    soft one a thousand times that of the solution, which costs PCG a dozen iterations.

    Local.
    """

    def __init__(self, scene: Scene, forest: Forest, prolongation: Prolongation) -> None:
        self._scene, self._comm = scene, forest.comm
        space = prolongation.space
        self._body = prolongation.injected(scene.mesh.body[forest.cell[space.example[:, 0]]].astype(np.int64))
        positions = prolongation.injected(space.positions())
        self._modes = np.ascontiguousarray(scene.rigid_motions.modes(positions, self._body).swapaxes(0, 1))

    def move(
        self,
        matrix: PETSc.Mat,
        base: FloatArray,
        jump: Jump,
        stiffness: FloatArray,
        u: FloatArray,
        supports: Supports,
    ) -> FloatArray:
        """Add the rigid motions R a of all bodies that minimise the energy: R^T (K + B^T k B) R a = R^T r.

        Collective on matrix.comm.

        Args:
            matrix: K without penalty.
            base: (owned, 3), right-hand side without contact [N].
            stiffness: (n,), k [N/m].
            u: (owned, 3), displacement so far [m].
            supports: at the owned conforming nodes.

        Returns:
            (owned, 3) [m].
        """
        rows, bodies = jump.rows, len(self._scene.mesh.bodies)
        modes = np.stack([supports.free_part(mode) for mode in self._modes])
        with PetscObjects() as objects:
            x, y = map(objects.add, matrix.createVecs())

            def product(values: FloatArray) -> FloatArray:
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
            diagonal = self._of_bodies(modes**2, x.array.reshape(-1, 3)).ravel()

        gram = np.zeros((bodies, 6, bodies, 6))
        gram[np.arange(bodies), :, np.arange(bodies)] = stiff
        row, body = jump.blocks.row, rows.bodies[jump.blocks.row, jump.blocks.side]
        across = np.zeros((len(rows), 6 * bodies))
        np.add.at(across, row, self._scene.rigid_motions.along(rows.position[row], body, jump.blocks.values))
        square = gram.reshape(6 * bodies, -1) + (across.T * stiffness) @ across
        sums = np.concatenate([square, force.reshape(1, -1), (diagonal + stiffness @ across**2)[None]])
        self._comm.Allreduce(MPI.IN_PLACE, sums)
        motion = _solved(sums[:-2], sums[-2], sums[-1]).reshape(bodies, 6)
        return u + np.einsum("nm,mni->ni", motion[self._body], modes)

    def _of_bodies(self, modes: FloatArray, values: FloatArray) -> FloatArray:
        """This rank's sums over each body of modes (6, owned, 3) times values (owned, 3): (nbodies, 6)."""
        work = [np.einsum("ni,ni->n", mode, values) for mode in modes]
        bodies = len(self._scene.mesh.bodies)
        return np.stack([np.bincount(self._body, one, minlength=bodies) for one in work], axis=1)


def _solved(matrix: FloatArray, right_hand_side: FloatArray, diagonal: FloatArray) -> FloatArray:
    """The minimum-norm solution of a symmetric system, scaled by its diagonal before cancellation."""
    scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, np.inf))
    values, vectors = np.linalg.eigh(scale[:, None] * (matrix + matrix.T) / 2 * scale)
    some = values > _UNRESISTED
    vectors = scale[:, None] * vectors[:, some]
    return vectors @ ((right_hand_side @ vectors) / values[some])


def relax(matrix: PETSc.Mat, base: FloatArray, term: PenaltyTerm, u: FloatArray, status: ActiveSet) -> FloatArray:
    """Smooth a displacement from a coarser mesh by PCG with block Jacobi, and update the active set by it.

    Its error has short wavelengths, at the edge of the contact.  The smoothed one has mostly the final active set, for
    which hypre is then set up once.  From zero displacement a few iterations would not reach the contact.

    Collective on matrix.comm.

    Args:
        matrix: with the penalty term of the active set, with which it changes.
        base: (owned, 3), right-hand side without contact [N].
        term: of all rows.
        u: (owned, 3), first guess [m].
        status: the active set, updated.

    Returns:
        (owned, 3) [m].
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
