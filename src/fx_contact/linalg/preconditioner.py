"""Preconditioners of PETSc: for a matrix, kept between set-ups, and projected on linear constraints."""

from petsc4py import PETSc

from fx_contact.linalg.matrix import as_aij, diagonal_blocks, shift_diagonal
from fx_contact.linalg.operator import PressureOperator, Projector
from fx_contact.linalg.p_multigrid import CoarseLevel, solved_here, within_blocks
from fx_contact.linalg.petsc_objects import PetscObjects, PetscOptions
from fx_contact.linalg.solver_options import PRECONDITIONERS
from fx_contact.parallel.arrays import Int64Array

#: Types of PC that need the entries between unknowns of one node alone.
_OF_NODES = ("pbjacobi", "jacobi", "none")


class Preconditioner:
    """M^-1 for a matrix, perhaps `singular`, or for its sum with a `volume` term, which changes no sparsity.

    Collective on options.comm.  hypre smooths with the values of the matrix itself, not with a copy: without `set_up`
    after a change of the matrix M may be indefinite.
    """

    def __init__(self, options: PetscOptions, objects: PetscObjects) -> None:
        self._options, self._objects = options, objects
        self.pc = objects.add(PETSc.PC().create(options.comm))
        self.pc.setOptionsPrefix(options.prefix)
        self.volume: PressureOperator | None = None
        self.singular = False
        self._copy: PETSc.Mat | None = None  # in AIJ
        self._smooths_blocks = False  # PETSc can be told once

    def set_up(self, matrix: PETSc.Mat, coarse: CoarseLevel | None = None) -> None:
        """Build it for the present values of a matrix, and for multigrid the level below.  Collective."""
        self.pc.setReusePreconditioner(False)
        suited = self._suited(matrix)
        self.pc.setOperators(suited, suited)
        if self.pc.getType() == PETSc.PC.Type.MG and coarse is not None:
            self.pc.setMGInterpolation(1, coarse.interpolation)
            self.pc.getMGCoarseSolve().setOperators(coarse.matrix)
            self._smooth(matrix, coarse.blocks)
        with self._options.reading(self._objects):
            self.pc.setUp()
        self._options.check_read()
        self.pc.setReusePreconditioner(True)

    def _suited(self, matrix: PETSc.Mat) -> PETSc.Mat:
        """The matrix for multigrid, and unless it is singular for hypre in its own format; else a copy in AIJ."""
        kind = self.pc.getType()
        own = kind == PETSc.PC.Type.HYPRE and matrix.type == PETSc.Mat.Type.HYPRE and not self.singular
        if kind == PETSc.PC.Type.MG or own:
            return matrix
        copy = as_aij(matrix)
        if self._copy is None:
            self._copy = self._objects.add(copy)
        else:  # the same object, whose sparsity MUMPS has analysed; converting into it spoils it
            copy.copy(self._copy, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
            copy.destroy()
        if self.volume is not None:
            self.volume.add_to(self._copy)
        if self.singular:
            shift_diagonal(self._copy)
        return self._copy

    def reset(self) -> None:
        """Free what `set_up` has made.  Collective."""
        self.pc.reset()
        if self._copy is not None:
            self._copy.destroy()
        self._copy = None

    def _smooth(self, matrix: PETSc.Mat, blocks: Int64Array | None) -> None:
        """Block smoother of multigrid, also for blocks with nodes of several ranks; None: a node is a block."""
        smoother = self.pc.getMGSmoother(1)
        if blocks is None:
            of_nodes = self._options.of_user.get("mg_levels_pc_type", "pbjacobi") in _OF_NODES
            smoother.setOperators(matrix, diagonal_blocks(matrix) if of_nodes else as_aij(matrix))
            return
        smoother.setOperators(matrix, within_blocks(matrix, blocks))
        if self._smooths_blocks:
            return
        self._smooths_blocks = True
        with self._options.reading(self._objects):
            smoother.setFromOptions()
        here = solved_here(matrix, blocks)
        smoother.getPC().setASMLocalSubdomains(1, [here])
        here.destroy()

    def name(self, asked: str) -> str:
        """The key of `PRECONDITIONERS` that was asked for if its type is in use, else the type in use.  Local."""
        options, kind = PRECONDITIONERS[asked], self.pc.getType()
        if kind == PETSc.PC.Type.HYPRE:
            kind = self.pc.getHYPREType()
        return asked if kind == options.get("pc_hypre_type", options["pc_type"]) else kind


class ProjectedPreconditioner:
    """P M^-1 P^T + S, with B P = 0, and S the inverse of the constraints' penalty; S = 0 for rigid constraints.

    Collective.  Without a projector it is M^-1, `inner`.  The vector is work space.
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

    def view(self, _: PETSc.PC, viewer: PETSc.Viewer) -> None:
        """The text of `-fx_ksp_view`."""
        self._inner.view(viewer)
