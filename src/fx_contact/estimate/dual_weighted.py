"""Errors of quantities of interest: dual-weighted residual estimates.

J(u) is to be linear as long as the closed node pairs stay closed.  Then it has a dual solution z,

    K z + B^T m = l,    B z = d on the closed pairs,    z = w at prescribed components.

A displacement or a gap has l = J'; the force of a contact pair d = 1 on its closed node pairs; the reaction at a place
w = 1 there, in its direction.  With the solutions u_h and z_h on a mesh

    |J(u) - J(u_h)| = |a(u - u_h, z - z_h)| <= sum_T xi_T(u) xi_T(z)

(J. T. Oden, S. Prudhomme, Comput. Math. Appl. 41, 2001; R. Becker, R. Rannacher, Acta Numer. 10, 2001; reactions:
W. Bangerth, R. Rannacher, Adaptive Finite Element Methods for Differential Equations, Birkhaeuser, 2003, chapter 11).
So a light contact is refined where its force is made, wherever that is, and whatever else stores energy.
"""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fx_contact.estimate.recovery import Estimate
from fx_contact.problem import hexahedron
from fx_contact.problem.lattice import leaf_side


@dataclass(frozen=True, eq=False)
class Functional:
    """A quantity of interest J, by its value at a solution and by the data of its dual problem.

    Attributes:
        value: J(u_h), in the unit of the quantity.
        size: what a relative error of it is relative to: |J(u_h)|, or the length of the vector that it is a component
            of.
        load: (owned, 3) float64, l; None: 0.
        penetration: (n,) float64, d of this rank's node pairs; None: 0.
        prescribed: (owned, 3) float64, w, 0 where no condition prescribes the component; None: 0.
        pointwise: whether it is of a point: then z has no energy norm in the limit, and the relative error of z_h, 0.3
            to 0.63 on cubes, stays as it is wherever the mesh is refined.  The products (e_u, e_z)_T still fall, as
            grad e_z does away from the point: the functional needs no regularisation.
    """

    value: float
    size: float
    load: np.ndarray | None = None
    penetration: np.ndarray | None = None
    prescribed: np.ndarray | None = None
    pointwise: bool = False

    def depends(self, comm):
        """Whether the dual problem has any data, on any rank.  Collective."""
        data = self.load, self.penetration, self.prescribed
        return comm.allreduce(any(array is not None and bool(array.any()) for array in data), op=MPI.LOR)


@dataclass(frozen=True, eq=False)
class Goal:
    """A quantity of interest and its estimated error.

    Attributes:
        value: of the quantity, as of the force of the modelled part [N], or the mean gap [m].
        error: (ncells,) float64, xi_T(u) xi_T(z) of this rank's cells, in the unit of the value.
        total: sum of these on all ranks.
        dual: Estimate of the dual solution.
        adjoint: (owned, 3) float64, the dual solution z.
        pressure: (n,) float64, contact pressure of the dual solution at this rank's node pairs.
    """

    value: float
    error: np.ndarray
    total: float
    dual: Estimate
    adjoint: np.ndarray
    pressure: np.ndarray


class Goals:
    """The quantities of interest of a step.

    Local.

    Args:
        state: SolvedState; the `u` of its elasticity is the displacement again after each goal.
        system: ContactSystem or LinearSystem of the solution.
        recovery: Recovery.
        stages: Stages, for the times.
    """

    def __init__(self, state, system, recovery, stages):
        self._state, self._system, self._recovery, self._stages = state, system, recovery, stages
        self._comm = state.forest.comm

    def of(self, functional):
        """Any quantity of interest: Goal.  Collective.

        Args:
            functional: Functional.
        """
        z, force, dual = self._dual(functional)
        error, pairs = self._state.estimate.error * dual.error, self._state.pairs
        return Goal(
            functional.value, error, self._sum(error), dual, z, force if pairs is None else force / pairs.area
        )

    def force(self, index):
        """The force of a contact pair, of the modelled part: Goal.  Collective.

        Args:
            index: of the contact pair.
        """
        solution = self._state.solution
        closed = (self._state.pairs.contact == index) & solution.active
        value = self._comm.allreduce(float(solution.force[closed].sum()))
        return self.of(Functional(value, abs(value), penetration=closed.astype(float)))

    def errors(self, goal):
        """A sharper error of a goal than xi_T(u) xi_T(z): (ncells,) float64 of this rank's cells, not negative.

        Collective.  Their sum is that of |sum_T (e_u, e_z)_T| over families P of cells T that have one parent, each of
        them with an equal share.  Within a family the products have both signs where z is that of a point, and cancel:
        the sum of |(e_u, e_z)_T| is up to three times as much.  Over wide distances they must not be trusted to do so:
        summed with their signs over all cells, those of a gap beside Hertz's contact are 0.01 to 0.6 of its error.

        Args:
            goal: Goal.
        """
        return _of_families(self._state.elasticity, self._products(goal))

    def _products(self, goal):
        """(e_u, e_z)_T of this rank's cells: (ncells,) float64.

        With xi_T^2 a quadratic form of what is estimated, by polarisation xi_T(u + s z)^2 - xi_T(u - s z)^2 =
        4 s (e_u, e_z)_T; far from what a goal is of, e_u and e_z have little to do with each other.
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
        return (squares[0] - squares[1]) / (4 * scale) if scale else np.zeros(len(goal.error))

    def _dual(self, functional):
        """A dual solution z, (owned, 3) float64, its contact forces (n,) float64, and its Estimate.

        What is prescribed is taken off: z = w + y with K y + B^T m = l - K w, B y = d - B w, and y = 0 at prescribed
        components.
        """
        elasticity, pairs = self._state.elasticity, self._state.pairs
        shape = self._state.solution.displacement.shape
        load = np.zeros(shape) if functional.load is None else functional.load
        penetration, w = functional.penetration, functional.prescribed
        if penetration is None:
            penetration = np.zeros(0 if pairs is None else len(pairs))
        try:
            if w is not None:
                elasticity.set_displacement(w)
                load = load - elasticity.internal_forces()
                penetration = penetration if pairs is None else penetration - pairs.jump(w)
            with self._stages("solve"):
                z, force = self._system.dual(load, penetration)
            z = z if w is None else z + w
            elasticity.set_displacement(z)
            return z, force, self._recovery.estimate(loaded=False)
        finally:
            elasticity.set_displacement(self._state.solution.displacement)

    def _sum(self, values):
        return self._comm.allreduce(float(values.sum()))


def gap_functional(state, weight):
    """The mean gap of a place: Functional.

    Collective on state.forest.comm.

    Args:
        state: SolvedState.
        weight: (n,) float64, the part of the place that each node pair is, 1 in all on all ranks [-].
    """
    left = np.maximum(-state.solution.penetration, 0.0)
    value = state.forest.comm.allreduce(float((weight * left).sum()))
    return Functional(value, value, load=-state.pairs.transposed(weight), pointwise=True)


def _of_families(elasticity, products):
    """|sum of the products| of the cells that have one parent, in equal shares; root cells are by themselves.

    Collective.  The middle of the parent, a corner of all of them that never hangs, stands for the family, which may
    be on several ranks.

    Args:
        elasticity: Elasticity.
        products: (ncells,) float64, signed, of this rank's cells.

    Returns:
        (ncells,) float64.
    """
    prolongation, leaf = elasticity.prolongation, elasticity.leaf_mesh.leaf
    space, forest = prolongation.space, prolongation.space.forest
    corner = (1 - forest.anchor[leaf] // leaf_side(forest.level[leaf])[:, None] % 2) @ [1, 2, 4]
    middle = prolongation.conforming[space.cells[leaf, hexahedron.corner_nodes(space.degree)[corner]]]
    alone, sums = forest.level[leaf] == 0, prolongation.zeros(2)
    np.add.at(sums, middle[~alone], np.column_stack([products, np.ones_like(products)])[~alone])
    total, count = prolongation.ghosted(prolongation.summed(sums))[middle].T
    return np.abs(np.divide(total, count, out=products.copy(), where=~alone))
