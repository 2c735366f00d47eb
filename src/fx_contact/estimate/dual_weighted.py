"""Errors of contact forces and of open gaps: dual-weighted residual estimates.

The force of a contact pair is F = L(z) - a(u, z), with z the dual solution for a unit penetration of its closed node
pairs and no loads.  With the solutions u_h and z_h on a mesh

    |F - F_h| = |a(u - u_h, z - z_h)| <= sum_T xi_T(u) xi_T(z).

The same holds of the mean of a gap, if z is the dual solution for unit forces that widen it (J. T. Oden, S. Prudhomme,
Comput. Math. Appl. 41, 2001; R. Becker, R. Rannacher, Acta Numer. 10, 2001).  So a light contact is refined where its
force is made, wherever that is, and whatever else stores energy.
"""

from dataclasses import dataclass

import numpy as np

from fx_contact.estimate.recovery import Estimate


@dataclass(frozen=True, eq=False)
class Goal:
    """A quantity of interest, the force of a contact pair or a mean gap, and its estimated error.

    Attributes:
        value: the force of the modelled part [N], or the mean gap [m].
        error: (ncells,) float64, xi_T(u) xi_T(z) of this rank's cells, in the unit of the value.
        total: sum of these on all ranks.
        dual: Estimate of the dual solution.
        adjoint: (owned, 3) float64, the dual solution z.
        moved: of a gap, |a(u, z)|, what strains contribute to it [m]; 0 of a force.
        compliance: of a gap, by how much a unit force there widens it [m/N]; 0 of a force.
    """

    value: float
    error: np.ndarray
    total: float
    dual: Estimate
    adjoint: np.ndarray
    moved: float = 0.0
    compliance: float = 0.0


class Goals:
    """The quantities of interest of a step: forces of contact pairs, and gaps of candidate places.

    Local.

    Args:
        state: SolvedState; the `u` of its elasticity is the displacement again after each goal.
        system: ContactSystem of the solution.
        recovery: Recovery.
        stages: Stages, for the times.
    """

    def __init__(self, state, system, recovery, stages):
        self._state, self._system, self._recovery, self._stages = state, system, recovery, stages
        self._comm = state.forest.comm

    def force(self, index):
        """The force of a contact pair: Goal.  Collective.

        Args:
            index: of the contact pair.
        """
        solution = self._state.solution
        closed = (self._state.pairs.contact == index) & solution.active
        value = self._comm.allreduce(float(solution.force[closed].sum()))
        z, dual = self._dual(closed.astype(float), np.zeros(len(closed)))
        error = self._state.estimate.error * dual.error
        return Goal(value, error, self._sum(error), dual, z)

    def gap(self, weight):
        """The mean gap of a place: Goal.  Collective.

        Args:
            weight: (n,) float64, the part of the place that each node pair is, 1 in all on all ranks [-].
        """
        left = np.maximum(-self._state.solution.penetration, 0.0)
        z, dual = self._dual(np.zeros(len(weight)), -weight)
        error = self._state.estimate.error * dual.error
        compliance = -self._sum(weight * self._state.pairs.jump(z))
        return Goal(self._sum(weight * left), error, self._sum(error), dual, z, self._moved(z), compliance)

    def products(self, goal):
        """|(e_u, e_z)_T|, a sharper error of a goal than xi_T(u) xi_T(z): (ncells,) float64 of this rank's cells.

        Collective.  With xi_T^2 a quadratic form of what is estimated, by polarisation
        xi_T(u + s z)^2 - xi_T(u - s z)^2 = 4 s (e_u, e_z)_T; far from what a goal is of, e_u and e_z have little to do
        with each other.

        Args:
            goal: Goal.
        """
        elasticity, u, estimate = self._state.elasticity, self._state.solution.displacement, self._state.estimate
        scale = estimate.error_global / goal.dual.error_global if goal.dual.error_global else 1.0
        squares = []
        try:
            for sign in (1, -1):
                elasticity.set_displacement(u + sign * scale * goal.adjoint)
                squares.append(self._recovery.estimate().error ** 2)
        finally:
            elasticity.set_displacement(u)
        return np.abs(squares[0] - squares[1]) / (4 * scale) if scale else np.zeros(len(goal.error))

    def _dual(self, penetration, force):
        """A dual solution z, (owned, 3) float64, and its Estimate."""
        elasticity = self._state.elasticity
        with self._stages("solve"):
            z = self._system.dual(penetration, force)
        elasticity.set_displacement(z)
        try:
            return z, self._recovery.estimate(loaded=False)
        finally:
            elasticity.set_displacement(self._state.solution.displacement)

    def _moved(self, z):
        """|a(u, z)| by polarisation: ||u + s z||^2 - ||u - s z||^2 = 4 s a(u, z)."""
        norm, u = self._state.elasticity.energy_norm, self._state.solution.displacement
        of_u, of_z = norm(u), norm(z)
        scale = of_u / of_z if of_u and of_z else 1.0  # that makes both alike
        return abs(norm(u + scale * z) ** 2 - norm(u - scale * z) ** 2) / (4 * scale)

    def _sum(self, values):
        return self._comm.allreduce(float(values.sum()))
