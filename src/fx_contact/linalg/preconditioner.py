"""Preconditioners of PETSc for a matrix, kept between set-ups, and on displacements that satisfy constraints."""

from mpi4py import MPI
from petsc4py import PETSc

from fx_contact.linalg.operator import Projector
from fx_contact.linalg.p_multigrid import CoarseLevel, solved_here, within_blocks
from fx_contact.linalg.petsc_objects import PetscObjects, petsc_errors
from fx_contact.linalg.petsc_options import PetscOptions
from fx_contact.linalg.solver_options import PRECONDITIONERS


class Preconditioner:
    """M^-1 for a matrix.

    hypre works on the values of the matrix itself, not on a copy.  Were they changed under it, its smoother would no
    longer fit and the preconditioner could become indefinite: `set_up` must follow a change.

    Collective on comm.

    Args:
        comm: of the run.
        options: read when the Krylov method reads its own.
        objects: free what is made here.

    Attributes:
        pc: PETSc PC.
    """

    def __init__(self, comm: MPI.Comm, options: PetscOptions, objects: PetscObjects) -> None:
        self._comm, self._options, self._objects = comm, options, objects
        self.pc = objects.add(PETSc.PC().create(comm))
        self.pc.setOptionsPrefix(options.prefix)
        self._smooths_blocks = False  # PETSc can be told once

    def set_up(self, matrix: PETSc.Mat, coarse: CoarseLevel | None = None) -> None:
        """Build it for the present values of a matrix, with the level below for a multigrid of two levels.  Collective.

        Raises:
            SceneError: an option of the user that PETSc does not read.
            SolveError: PETSc cannot build it.
        """
        self.pc.setReusePreconditioner(False)
        self.pc.setOperators(matrix, matrix)
        if self.pc.getType() == PETSc.PC.Type.MG and coarse is not None:
            self.pc.setMGInterpolation(1, coarse.interpolation)
            self.pc.getMGCoarseSolve().setOperators(coarse.matrix)
            if coarse.blocks is not None:
                self._smooth_blocks(matrix, coarse)
        with self._options.there(), petsc_errors(self._comm, self._options.prefix, self._objects):
            self.pc.setUp()
        self._options.check_read()
        self.pc.setReusePreconditioner(True)

    def _smooth_blocks(self, matrix: PETSc.Mat, coarse: CoarseLevel) -> None:
        """Let the smoother of multigrid solve for blocks of nodes at once, whatever ranks own them."""
        smoother, inside = self.pc.getMGSmoother(1), within_blocks(matrix, coarse.blocks)
        smoother.setOperators(matrix, inside)
        inside.destroy()  # the smoother has a reference
        if self._smooths_blocks:
            return
        self._smooths_blocks = True
        with self._options.there(), petsc_errors(self._comm, self._options.prefix, self._objects):
            smoother.setFromOptions()
        here = solved_here(matrix, coarse.blocks)
        smoother.getPC().setASMLocalSubdomains(1, [here])
        here.destroy()

    @property
    def failed(self) -> bool:
        """Whether a factorisation has failed.  Local; the same on all ranks."""
        return bool(self.pc.getFailedReason())

    def reset(self) -> None:
        """Free its memory."""
        self.pc.reset()

    def name(self, asked: str) -> str:
        """The key of `PRECONDITIONERS` that was asked for if PETSc has taken it, else the type that it took.  Local."""
        options, kind = PRECONDITIONERS[asked], self.pc.getType()
        if kind == PETSc.PC.Type.HYPRE:
            kind = self.pc.getHYPREType()
        return asked if kind == options.get("pc_hypre_type", options["pc_type"]) else kind


class ProjectedPreconditioner:
    """P M^-1 P^T + S: P projects on B u = 0; S is the inverse of the penalty by which constraints yield.

    The stiffer the penalty, the weaker the coupling of the two parts; S = 0 for rigid constraints.

    Collective.

    Args:
        inner: M^-1.
        vector: a Vec of the matrix, overwritten.

    Attributes:
        projector: P; None: M^-1 alone.
    """

    def __init__(self, inner: Preconditioner, vector: PETSc.Vec) -> None:
        self._inner, self._vector = inner.pc, vector
        self.projector: Projector | None = None

    def apply(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """y := (P M^-1 P^T + S) x."""
        if self.projector is None:
            self._inner.apply(x, y)
            return
        x.copy(self._vector)
        forces = self.projector.apply_transpose(self._vector.array.reshape(-1, 3))
        self._inner.apply(self._vector, y)
        u = y.array.reshape(-1, 3)
        self.projector.apply(u)
        self.projector.add_yielding(forces, u)

    def view(self, viewer: PETSc.Viewer) -> None:
        """The text of `-fx_ksp_view`."""
        self._inner.view(viewer)
