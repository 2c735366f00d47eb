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
from mpi4py import MPI

#: The error that the mean of a gap may have so that it is one, relative to it: the least is a half of the mean.
OPEN = 0.25
#: A dual solution whose own relative error seems larger tells nothing: 0.69 and 0.70 were seen where thin cells lock in
#: bending, and 0.59 where a single node is pressed.
BLIND = 0.65
#: The part of the allowed error that refinement aims at, and that which cells that are not refined keep at most.
_AIM, _KEPT = 0.8, 0.25
#: Errors of a child and of all eight, relative to their parent's, where both solutions are smooth.
_CHILD, _CHILDREN = 1 / 32, 1 / 4
#: Thresholds between which marking chooses, down to so much of the largest error.
_THRESHOLDS, _LEAST = 1024, 1e-12


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
        self._elasticity.set_displacement(u)
        return abs(above**2 - below**2) / (4 * scale)

    def _sum(self, values):
        return self._comm.allreduce(float(values.sum()))


def allowed_errors(forces, tolerance, effectivity):
    """Relative errors that forces of contact pairs may have: e of what each should be, or e^2 of the largest.

    Local.

    Args:
        forces: (npairs,) float64, or a list, `pair_forces` of a record [N].
        tolerance: prescribed accuracy e [-].
        effectivity: the part of the error that the estimate sees [-].

    Returns:
        (npairs,) float64, relative to the forces that they have [-].
    """
    forces = np.abs(forces)
    light = np.divide(forces.max(initial=0.0), forces, out=np.full(len(forces), np.inf), where=forces > 0)
    allowed = np.maximum(tolerance, tolerance**2 * light)
    return effectivity / (1 + 1 / allowed)


def marked(error, allowed, comm):
    """How often to refine each cell: the fewest that bring the sum of the errors below what is allowed.

    Collective on comm.  Cells whose children would be among the largest again are refined twice.  Where that does not
    suffice, the others keep little of what is allowed.

    Args:
        error: (ncells,) float64, of this rank's cells.
        allowed: sum of the errors of all ranks' cells that is allowed.
        comm: MPI communicator.

    Returns:
        (ncells,) int8, 0, 1 or 2.
    """
    largest = comm.allreduce(float(error.max(initial=0.0)), op=MPI.MAX)
    thresholds = np.geomspace(1.0, _LEAST, _THRESHOLDS) * largest
    # The first threshold, from the highest down, that a cell exceeds, and that its children would.
    places = [np.searchsorted(-thresholds, -share * error, side="right") for share in (1.0, _CHILD)]
    sums = np.stack([np.bincount(place, error, _THRESHOLDS + 1) for place in places])
    comm.Allreduce(MPI.IN_PLACE, sums)
    once, twice = np.cumsum(sums, axis=1)
    left = once[-1] - (1 - _CHILDREN) * (once + _CHILDREN * twice)
    enough = (left <= _AIM * allowed) | (once[-1] - once <= _KEPT * allowed)
    return sum((place <= int(np.argmax(enough))).astype(np.int8) for place in places)
