"""The stopping rule of Krylov methods: the error in the energy norm, relative to that of the solution.

Let A be the operator, M its preconditioner, r the residual, e the error and omega the energy norm (4).  PCG measures
the error by the natural norm,

    |r|_M = (r^T M^-1 r)^(1/2)  ~  (r^T A^-1 r)^(1/2) = (e^T A e)^(1/2),

and goes on from u_0 until

    |r|_M <= max(tol w, tol |r_0|_M, eps |D^(1/2) u_0|),    w = omega(u_0),  D = diag A,  eps = 1e-14 (rounding).

If the solution has less than half the energy norm that this was relative to, omega(u) < max(w, |r_0|_M) / 2, PCG starts
again with w = omega(u).  As omega(u) >= omega(u_0) - |u - u_0|_A, omega(u) is seldom needed.
"""

from collections.abc import Callable

import numpy as np
from mpi4py import MPI

from fx_contact.linalg.operator import Array
from fx_contact.parallel.errors import SolveError

#: Relative error of a product with the operator, by rounding, with some room.
ROUNDING = 1e-14

#: omega of a displacement (owned, 3) [m]: [J^(1/2)]; collective.
EnergyNorm = Callable[[Array], float]


class StoppingRule:
    """The error that a solution may have.

    Collective on comm.

    Args:
        comm: of the run.
        energy_norm: omega.
        diagonal: (owned, 3), D [N/m].
    """

    def __init__(self, comm: MPI.Comm, energy_norm: EnergyNorm, diagonal: Array) -> None:
        self._comm, self._energy_norm, self._root = comm, energy_norm, np.sqrt(np.abs(diagonal))

    def allowed(self, u: Array, tolerance: float, reference: float | None = None) -> float:
        """The error allowed near u [J^(1/2)], relative to an energy norm, by default omega(u).

        Raises:
            SolveError: an energy norm that is not finite.
        """
        reference = self._energy_norm(u) if reference is None else reference
        scaled = (self._root * u).ravel()
        rounding = ROUNDING * float(np.sqrt(self._comm.allreduce(float(scaled @ scaled))))
        if not np.isfinite(reference + rounding):
            raise SolveError(
                f"the energy norm of the displacement that PCG goes on from is {reference} J^(1/2): check the "
                "units of lengths, moduli and displacements"
            )
        return max(tolerance * reference, rounding)

    def begin(self, u: Array, tolerance: float) -> "EnergyError":
        """The rule for one solve by PCG, from a first guess."""
        return EnergyError(self, self._energy_norm, u, tolerance)


class EnergyError:
    """The rule for one solve by PCG: the norm to which its error is relative.

    Collective.

    Attributes:
        value: error bound of the last run of PCG that has converged [J^(1/2)]; NaN before.
    """

    def __init__(self, rule: StoppingRule, energy_norm: EnergyNorm, u: Array, tolerance: float) -> None:
        self._rule, self._energy_norm, self._tolerance = rule, energy_norm, tolerance
        self._start = self._reference = energy_norm(u)
        self.value, self._allowed = np.nan, np.nan

    def allowed(self, u: Array) -> float:
        """The error at which a run of PCG from u ends [J^(1/2)]."""
        self._allowed = self._rule.allowed(u, self._tolerance, self._reference)
        return self._allowed

    def is_met(self, u: Array, first: float, moved: float) -> bool:
        """Whether a converged run ends the solve.

        Args:
            u: its solution.
            first: |r_0|_M [J^(1/2)].
            moved: |u - u_0|_A [J^(1/2)].
        """
        reference = max(self._reference, first)
        self.value = max(self._allowed, self._tolerance * first)
        if self._start - moved >= 0.5 * reference:
            return True
        self._start = self._reference = self._energy_norm(u)
        return self._start >= 0.5 * reference
