"""FGMRES for nearly incompressible bodies, whose pressures are unknowns beside the displacement.

K = A + D^T C D is not assembled.  M is a preconditioner of the matrix A, S an approximation of the Schur complement:

    [ A   D^T  ] [u]   [f]                          [ M  D^T ]^-1
    [ D  -C^-1 ] [s] = [0],     preconditioned by   [ 0  -S  ]

Iterations hardly depend on lambda (M. F. Murphy, G. H. Golub, A. J. Wathen, SIAM J. Sci. Comput. 21(6),
2000).  The rows leave residuals r and q.  As K >= A and K >= D^T C D, the error e of the displacement has

    (e^T K e)^(1/2)  <=  (r^T A^-1 r)^(1/2) + |C^(1/2) q|  ~  |r|_M + |C^(1/2) q|.

FGMRES goes on until that bound is at most tol omega(u), or rounding.

In thin bodies that bend S is far off.  Where Cholesky's factors take over they are of K, and PCG solves K u = f.
"""

import numpy as np
from petsc4py import PETSc

from fx_contact.linalg.conjugate_gradients import LOOKS, ConjugateGradients
from fx_contact.linalg.krylov_solver import KrylovSolver

#: Iterations after which FGMRES begins anew: more than it takes but on flat cells.  Each keeps two vectors, so that a
#: hundred take 200 * 8 * 28 / 24 = 1.9 kB an unknown, about as much as the matrix.
_RESTART = 100


class MixedSolver(ConjugateGradients):
    """As ConjugateGradients, with the volume strains of nearly incompressible bodies beside the matrix.

    Collective on matrix.comm.

    Args:
        matrix: BlockMatrix A, symmetric positive definite; it is used up.
        volume: VolumeTerm, D and C.
        solver, energy_norm, objects, coarse: as for ConjugateGradients; the energy norm is that of K.

    Attributes:
        pressure: (m,) float64, s of the last solution [Pa m^(3/2)].

    Raises:
        SceneError, SolveError: as ConjugateGradients.
    """

    #: The last solve's iterations, and microseconds an unknown of all solves, with 1, 2, 3: clamped blocks at 0.499 42,
    #: 38, 34 and 28, 24, 23; Hertz at 0.49999 26, 23, 22 and 52, 47, 46 (`studies.incompressible.run --cycles`).
    _CYCLES = 3
    _LOOKS_OF_FLAT = LOOKS  # it takes 19 to 48 iterations on flat cells where it does not bend (`studies.cost.flat`)
    _whole = False  # whether the matrix is K, with Cholesky's factors

    def __init__(self, matrix, volume, solver, energy_norm, objects, coarse=None):
        self.volume, self.pressure = volume, np.zeros(len(volume))
        super().__init__(matrix, solver, energy_norm, objects, coarse)

    def _create_krylov(self, direct=False):
        if direct:
            return super()._create_krylov(direct)
        return FlexibleGmres(self._comm, self._options, self._objects)

    def _to_factorise(self):
        """K itself, assembled.  Collective."""
        matrix = super()._to_factorise()
        self.volume.add_to(matrix)
        return matrix

    def _take_over(self, name, options, krylov, matrix):
        super()._take_over(name, options, krylov, matrix)
        self._whole = not isinstance(krylov, FlexibleGmres)

    def residual(self, right_hand_side, u):
        """As `ConjugateGradients.residual`, of the last solution, with its pressure.  Collective."""
        forces = super().residual(right_hand_side, u)
        return forces - (self.volume.forces_of_held(u) if self._whole else self.volume.forces(self.pressure))

    def set_up(self):
        """As `ConjugateGradients.set_up`.  Collective."""
        super().set_up()
        if self._whole:
            return
        self._root_of_matrix = self._scale.array.reshape(-1, 3).copy()
        self._scale.array[:] = np.sqrt(self._scale.array**2 + self.volume.diagonal().ravel())

    def _attempt(self, right_hand_side, u, tolerance, held, most):
        """As `ConjugateGradients._attempt`, by the stopping rule above.  Collective."""
        if self._whole:
            return super()._attempt(right_hand_side, u, tolerance, held, most)
        volume, strains = self.volume, self.volume.strains(u)
        self.pressure = self._first_pressure(strains)
        forces = self.residual(right_hand_side, u)
        system = MixedSystem(self._product, volume, self._root_of_matrix, held)

        def allowed(change):
            """The error that a solution may have: u plus a change."""
            self.energy_error = max(tolerance * self._energy_norm(u + change), self._rounding_error(u + change))
            return self.energy_error

        residual = forces, self.pressure / volume.missing - strains
        reason, count, change, more = self._krylov.solve_mixed(system, residual, tolerance, allowed, most)
        self.pressure = self.pressure + more
        return u + change, reason, count

    def _first_pressure(self, strains):
        """That of the last solution if it fits the strains, (m,) float64, better than none does."""
        root = np.sqrt(self.volume.missing)
        left = root * (strains - self.pressure / self.volume.missing), root * strains
        with_it, without = self._comm.allreduce(np.array([part @ part for part in left]))
        return self.pressure if with_it < without else np.zeros_like(self.pressure)


class MixedSystem:
    """The operator on displacement and pressure, in the units J^(1/2) of rows scaled by diag(A)^(-1/2) and C^(1/2).

    Collective.

    Args:
        product: of the matrix and its correction, as PETSc calls it.
        volume: VolumeTerm.
        root: (owned, 3) float64, roots of the diagonal of A.
        held: constraint projector P, B P = 0, or None.
    """

    def __init__(self, product, volume, root, held):
        self._product, self.volume, self.held = product, volume, held
        self._root, self._weight = root.ravel(), np.sqrt(volume.missing)

    @property
    def size(self):
        """Unknowns of this rank."""
        return len(self._root) + len(self._weight)

    def scaled(self, forces, strains):
        """A residual (owned, 3) [N], (m,) [m^(3/2)] as rows: (n + m,) float64.  Collective."""
        if self.held is not None and self.held.rigid:
            self.held.apply_transpose(forces)
        return np.concatenate([forces.ravel() / self._root, self._weight * strains])

    def unscaled(self, rows):
        """The inverse of `scaled`.  Local."""
        n = len(self._root)
        return (rows[:n] * self._root).reshape(-1, 3), rows[n:] / self._weight

    def parts(self, values):
        """Displacement (owned, 3) [m] and pressure (m,) of unknowns (n + m,).  Local."""
        n = len(self._root)
        return values[:n].reshape(-1, 3), values[n:]

    def times(self, values, x, y):
        """The operator times unknowns (n + m,), with two Vecs of the matrix: rows (n + m,).  Collective."""
        u, pressure = self.parts(values)
        x.array[:] = u.ravel()
        self._product.mult(None, x, y)
        forces = y.array.reshape(-1, 3) + self.volume.forces(pressure)
        return self.scaled(forces, self.volume.strains(u) - pressure / self.volume.missing)


class FlexibleGmres(KrylovSolver):
    """FGMRES with the block triangular preconditioner.

    Collective on comm; arguments and errors as for KrylovSolver.
    """

    METHODS = ("fgmres",)
    _NORM = PETSc.KSP.NormType.UNPRECONDITIONED
    _context = None

    def _set_up(self, operator, matrix):
        self.pc.setUp()

    def solve_mixed(self, system, residual, tolerance, allowed, max_it):
        """Solve from zero until the bound of the error in the energy norm is at most what is allowed.

        Collective on comm.  The bound takes a preconditioner, and is looked at where the residual suggests that it is
        met.

        Args:
            system: MixedSystem.
            residual: (owned, 3) and (m,) float64, right-hand side [N], [m^(3/2)].
            tolerance: of the error; the energy norm to which it is relative is at most that of a guess and its bound.
            allowed: function of a displacement (owned, 3) [m]: the error that it may have [J^(1/2)]; collective.
            max_it: most iterations.

        Returns:
            PETSc's reason for the end, negative for a failure; the number of iterations; displacement (owned, 3) [m];
            pressure (m,) [Pa m^(3/2)].
        """
        context, reasons, next_look = self._prepared(system), PETSc.KSP.ConvergedReason, np.inf

        def converged(ksp, count, norm):
            """PETSc's reason to end, or to go on."""
            nonlocal next_look
            if norm > next_look:
                return reasons.DIVERGED_MAX_IT if count >= max_it else reasons.ITERATING
            bound = context.bound(_array(ksp.buildResidual()))
            most = allowed(system.parts(_array(ksp.buildSolution()))[0])
            if bound <= most:
                return reasons.CONVERGED_RTOL
            next_look = norm * min(most / bound + tolerance, 0.5)
            return reasons.ITERATING

        ksp, (x, b) = self._ksp, context.outer
        ksp.setConvergenceTest(converged)
        b.array[:] = system.scaled(*residual)
        with self._errors_on_all_ranks():
            ksp.solve(b, x)
        reason = ksp.getConvergedReason()
        if reason > 0 and not np.isfinite(x.norm()):
            reason = reasons.DIVERGED_NANORINF
        return reason, ksp.getIterationNumber(), *system.parts(x.array.copy())

    def _prepared(self, system):
        """The context for a system; PETSc's objects are made once, for all have one size."""
        if self._context is None:
            matrix, sizes = self.pc.getOperators()[1], ((system.size, PETSc.DETERMINE),) * 2
            self._context = context = _Context([self._objects.add(matrix.createVecRight()) for _ in range(2)])
            operator = self._objects.add(PETSc.Mat().createPython(sizes, context, self._comm))
            outer = self._objects.add(PETSc.PC().createPython(context, self._comm))
            outer.setOperators(operator, operator)
            context.outer = tuple(map(self._objects.add, operator.createVecs()))
            self._ksp.setPC(outer)
            self._ksp.setOperators(operator, operator)
            self._ksp.setGMRESRestart(_RESTART)
        self._context.system = system
        self._context.inner = self.pc if system.held is None else self._holding_pc(system.held)
        return self._context


class _Context:
    """The operator and the preconditioner, as PETSc calls them."""

    def __init__(self, vectors):
        self._vectors, self.system, self.inner, self.outer = vectors, None, None, None

    def mult(self, _, x, y):
        """Rows of unknowns."""
        y.array[:] = self.system.times(x.array_r, *self._vectors)

    def apply(self, _, x, y):
        """The unknowns that solve the block triangular system."""
        volume, (forces, strains) = self.system.volume, self.system.unscaled(x.array_r)
        pressure = -volume.schur * strains
        displacement = self._inverse(forces - volume.forces(pressure))
        y.array[:] = np.concatenate([displacement.ravel(), pressure])

    def bound(self, rows):
        """|r|_M + |C^(1/2) q| of a residual, rows (n + m,): float [J^(1/2)].  Collective."""
        forces, strains = self.system.unscaled(rows)
        squares = (forces * self._inverse(forces)).sum(), self.system.volume.missing @ strains**2
        squares = self.system.volume.comm.allreduce(np.array(squares))
        return float(np.sqrt(np.maximum(squares, 0.0)).sum())

    def _inverse(self, forces):
        """M^-1 of forces (owned, 3) [N], which the next call overwrites: (owned, 3) [m]."""
        x, y = self._vectors
        x.array[:] = forces.ravel()
        self.inner.apply(x, y)
        return y.array.reshape(-1, 3)


def _array(vector):
    """The values of a Vec that is destroyed.  Collective."""
    values = vector.array.copy()
    vector.destroy()
    return values
