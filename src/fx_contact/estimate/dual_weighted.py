"""Errors of contact forces and of open gaps: goal-oriented estimates, by the solutions of dual problems.

The force of a contact pair is F = L(z) - a(u, z): its dual solution z is how the bodies answer if its closed node pairs
overlap by 1 and nothing else moves or loads them.  With the solutions u_h and z_h on a mesh, F - F_h = a(u - u_h,
z - z_h), at most the sum of xi_T(u) xi_T(z) over the cells.  The same holds of the mean of a gap, if z is how they
answer to forces that widen it (J. T. Oden, S. Prudhomme, Comput. Math. Appl. 41, 2001; R. Becker, R. Rannacher, Acta
Numer. 10, 2001).  So a light contact is refined where its force is made, wherever that is, and whatever else stores
energy.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Goal:
    """A force or a gap, and what is wrong with it.

    Attributes:
        value: the force of the modelled part [N], or the mean gap [m].
        error: (ncells,) float64, xi_T(u) xi_T(z) of this rank's cells, in the unit of the value.
        total: sum of these on all ranks.
        dual: Estimate of the dual solution.
        moved: of a gap, how much the strains of the bodies contribute to it [m]; 0 of a force.
        compliance: of a gap, by how much a force there widens it [m/N]; 0 of a force.
    """

    value: float
    error: np.ndarray
    total: float
    dual: object
    moved: float = 0.0
    compliance: float = 0.0


class Goals:
    """The goals of a step: forces of contact pairs, and gaps of open places.

    Local.

    Args:
        elasticity: Elasticity; its `u` is the displacement, and is so again after each goal.
        system: ContactSystem of the solution.
        recovery: Recovery.
        stages: Stages, for the times.
        pairs: NodePairs.
        contact: ContactSolution.
        error: Estimate of its error.
    """

    def __init__(self, elasticity, system, recovery, stages, pairs, contact, error):
        self._elasticity, self._system, self._recovery, self._stages = elasticity, system, recovery, stages
        self._pairs, self._contact, self._error = pairs, contact, error
        self._comm = pairs.prolongation.comm

    def force(self, index):
        """The force of a contact pair: Goal.  Collective.

        Args:
            index: of the contact pair.
        """
        ours = (self._pairs.contact == index) & self._contact.active
        value = self._comm.allreduce(float(self._contact.force[ours].sum()))
        _, dual = self._weighted(ours.astype(float), np.zeros(len(ours)))
        error = self._error.error * dual.error
        return Goal(value, error, self._sum(error), dual)

    def gap(self, weight):
        """The mean gap of an open place: Goal.  Collective.

        Args:
            weight: (n,) float64, the part of the place that each pair is, 1 in all on all ranks [-].
        """
        left = np.maximum(-self._contact.penetration, 0.0)
        u, dual = self._weighted(np.zeros(len(weight)), -weight)
        error, compliance = self._error.error * dual.error, -self._sum(weight * self._pairs.jump(u))
        return Goal(self._sum(weight * left), error, self._sum(error), dual, self._moved(u), compliance)

    def _weighted(self, overlap, force):
        """A dual solution, (owned, 3) float64, and its Estimate."""
        with self._stages("solve"):
            dual = self._system.dual(overlap, force)
        self._elasticity.set_displacement(dual)
        error = self._recovery.estimate()
        self._elasticity.set_displacement(self._contact.displacement)
        return dual, error

    def _moved(self, dual):
        """|a(u, z)|, what strains contribute to the goal of a dual solution."""
        norm, u = self._elasticity.energy_norm, self._contact.displacement
        own, other = norm(u), norm(dual)
        scale = own / other if own and other else 1.0  # that makes both alike
        above, below = norm(u + scale * dual), norm(u - scale * dual)
        return abs(above**2 - below**2) / (4 * scale)

    def _sum(self, values):
        return self._comm.allreduce(float(values.sum()))
