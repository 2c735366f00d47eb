"""The effectivity of the error estimator, measured by the solutions on two successive meshes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fx_contact.estimate.estimator import Estimate


@dataclass(frozen=True)
class RefinementHistory:
    """Refinements of a run, and the effectivity that they show.

    Attributes:
        effectivity: theta = xi / ||u - u_h||, estimated over true error, measured or assumed [-].
        error2: xi^2 of the mesh that was refined last [J].
        expected_loss: of xi^2 by that refinement if the solution is smooth; 0: unknown [J].
        refined: the present mesh is a refinement of the one before.
        compared: theta has been measured, or is bounded by `effectivity`, so that one mesh may be enough.
    """

    effectivity: float
    error2: float = 0.0
    expected_loss: float = 0.0
    refined: bool = False
    compared: bool = False

    def observed(self, estimate: Estimate, change: float, least: float) -> RefinementHistory:
        """The history with the effectivity on the mesh before, by the estimate on the present one.

        Local.  On nested meshes H, h energy errors add in squares (Galerkin orthogonality):

            ||u - u_H||^2 = ||u_h - u_H||^2 + ||u - u_h||^2,  ||u - u_h|| ~ xi_h / theta,  theta = xi_H / ||u - u_H||.

        `change` is ||u_h - u_H||, as from `Elasticity.change_norm` [J^(1/2)], `least` a lower bound of theta [-].
        """
        if not self.refined:
            return self
        theta = self.effectivity
        for _ in range(2):  # fixed-point iterations
            coarse_error = float(np.hypot(change, estimate.error_global / theta))
            measured = float(np.sqrt(self.error2) / coarse_error) if coarse_error else 1.0
            theta = min(max(measured, least), 1.0)
        return replace(self, effectivity=theta, compared=True)

    def loss_rate(self, estimate: Estimate) -> float | None:
        """Loss of xi^2 by the last refinement / loss of a smooth solution, at most 1; None: unknown.  Local."""
        lost = self.error2 - estimate.error_global**2
        return min(lost / self.expected_loss, 1.0) if self.expected_loss and lost > 0 else None
