"""The stopping rule of Krylov methods: the error in the energy norm, relative to that of the solution.

Let A be the operator, M its preconditioner, r the residual, e the error and omega the energy norm (4).  PCG measures
the error by the natural norm,

    |r|_M = (r^T M^-1 r)^(1/2)  ~  (r^T A^-1 r)^(1/2) = (e^T A e)^(1/2),

and stops, from a first guess u_0, when

    |r|_M <= max(tol w, tol |r_0|_M, eps |D^(1/2) u_0|),    w = omega(u_0),  D = diag A,  eps = 1e-14 (rounding).

If omega(u) < max(w, |r_0|_M) / 2, PCG restarts with w = omega(u).  The lower bound omega(u_0) - |u - u_0|_A mostly
excludes this, so that omega(u) is seldom computed.
"""

from collections.abc import Callable

import numpy as np
from mpi4py import MPI

from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import SolveError

#: Relative error of a product with the operator, by rounding, with some room.
ROUNDING = 1e-14

#: omega of a displacement (owned, 3) [m]: [J^(1/2)]; collective.
EnergyNorm = Callable[[FloatArray], float]


class StoppingRule:
    """The allowed error of a solution, by omega and D, (owned, 3) [N/m].  Collective on comm."""

    def __init__(self, comm: MPI.Intracomm, energy_norm: EnergyNorm, diagonal: FloatArray) -> None:
        self._comm, self.energy_norm, self._root = comm, energy_norm, np.sqrt(np.abs(diagonal))

    def allowed(self, u: FloatArray, tolerance: float, reference: float | None = None) -> float:
        """The error allowed near u [J^(1/2)], relative to an energy norm, by default omega(u).

        Raises SolveError for an energy norm that is not finite.
        """
        reference = self.energy_norm(u) if reference is None else reference
        scaled = (self._root * u).ravel()
        rounding = ROUNDING * float(np.sqrt(self._comm.allreduce(float(scaled @ scaled))))
        if not np.isfinite(reference + rounding):
            raise SolveError(
                f"the energy norm of the displacement that PCG goes on from is {reference} J^(1/2): check the "
                "units of lengths, moduli and displacements"
            )
        return max(tolerance * reference, rounding)
