"""Errors of quantities of interest: dual-weighted residual estimates.

J(u) is linear for a fixed set of closed node pairs.  Its dual solution z satisfies

    K z + B^T m = l,    B z = d on the closed pairs,    z = w at prescribed components.

    displacement, gap          l = J'
    force of a contact pair    d = 1 on its closed node pairs
    reaction at a place        w = 1 there, in its direction
    friction force             d = 1 in its direction where nodes stick, mu e . direction in normals that slip along e.

The dual problem keeps the slip forces: that their bounds depend on the normal forces is neglected in it.

The estimate of |J(u) - J(u_h)| is

    sum_P |sum_T (e_u, e_z)_T| + int |p_z| |g - g_I| dA + int p |d - B z| dA.

P are the families of cells T of one parent, e_u and e_z the estimated errors of u_h and z_h.  The gap g differs from
its interpolant g_I between the nodes; p_z is the contact pressure of z.  The last term is that of the edge of the
contact, which the mesh places at nodes (`contact_edge`).

A lightly loaded contact is thus refined where its force arises, whatever energy other loads store.

Unknown motions along given forces give way in dual problems too: those of sections and rigid faces in the linear
system, those of obstacles with their rates v and the solutions z_v, m_v of `law.settling` by the dual solution
z + c z_v, where v . (m + c m_v) = 0.  The force on an obstacle is known: its error is that of the distance times the
stiffness.

Sources: J. T. Oden, S. Prudhomme, Comput. Math. Appl. 41, 2001; R. Becker, R. Rannacher, Acta Numer. 10, 2001;
reactions: W. Bangerth, R. Rannacher, Adaptive Finite Element Methods for Differential Equations, Birkhaeuser, 2003,
chapter 11.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from mpi4py import MPI

from fx_contact.contact.constraint_rows import Role
from fx_contact.contact.contact_system import ContactSystem, LinearSystem
from fx_contact.contact.row_motions import RowMotions
from fx_contact.estimate.contact_edge import ContactEdge
from fx_contact.estimate.estimator import DisplacementError, Estimate, Estimator
from fx_contact.estimate.inter_node_gap import GapBetweenNodes
from fx_contact.estimate.solved_state import SolvedState
from fx_contact.fem.elasticity import Elasticity
from fx_contact.geometry import hexahedron
from fx_contact.geometry.lattice import leaf_side
from fx_contact.law.settling import sensitivities
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.timing import Stages

#: Tolerances of the dual solution, relative to its energy norm.  An error of z changes the estimate by about
#: xi(u) |z - z_h|_A at most (Cauchy-Schwarz): by less than 0.32 of that in 14 runs of hertz, indentation, punch, stack,
#: spheres, cylinders and shrink_fit at both degrees.  _LOOSE takes 2 or 3 iterations and suffices for a bound, the
#: estimate plus this change, on any number of ranks; _TIGHT takes 9 to 24.  The share of a penalty needs _TIGHT.
_LOOSE, _TIGHT = 0.2, 1e-6
#: Slopes of the forces of obstacles, relative to the largest, that are rounding: of those on a body that is free.
_UNRESISTED = 1e-10


@dataclass(frozen=True, eq=False)
class Functional:
    """A quantity of interest J at a solution, and the data of its dual problem; None, and no rows: 0.

    Attributes:
        value: J(u_h).
        size: reference of relative errors: |J(u_h)|, or the length of the vector of which J is a component.
        load: (owned, 3), l.
        penetration: (n,), d.
        prescribed: (owned, 3), w, 0 in components that are not prescribed.
        local: (n,), error at each row that the dual solution does not contain, in the unit of the value; the largest
            one counts.
        fixed: obstacles that settle under forces stay in place.
        beyond: (n,), d of open rows if they were closed.
        tangential: (n + m, 3), of all rows: d of each tangent is its component along it.
    """

    value: float
    size: float
    load: FloatArray | None = None
    penetration: FloatArray = field(default_factory=lambda: np.zeros(0))
    prescribed: FloatArray | None = None
    local: FloatArray = field(default_factory=lambda: np.zeros(0))
    fixed: bool = False
    beyond: FloatArray | None = None
    tangential: FloatArray | None = None

    def depends(self, comm: MPI.Intracomm) -> bool:
        """True if the dual problem has data on any rank.  Collective."""
        data = self.load, self.penetration, self.prescribed, self.tangential
        return bool(comm.allreduce(any(array is not None and bool(array.any()) for array in data), op=MPI.LOR))


@dataclass(frozen=True, eq=False)
class Goal:
    """Value and estimated error of a quantity of interest.

    Attributes:
        error: (ncells,), contributions of the cells, not negative, in the unit of the value.
        total: their sum on all ranks, or an upper bound of the sum for the exact z.
        dual: estimate of the dual solution.
        adjoint: (owned, 3), the dual solution z.
        pressure: (n,), contact pressure of z.
    """

    value: float
    error: FloatArray
    total: float
    dual: Estimate
    adjoint: FloatArray
    pressure: FloatArray


class Goals:
    """Errors of the quantities of interest of a step, each by one adjoint solution.

    Local.  With `bounds` the error is an upper bound, but for the edge of the contact, where the allowed error
    permits it.
    """

    def __init__(
        self,
        state: SolvedState,
        error: DisplacementError,
        estimator: Estimator,
        system: ContactSystem | LinearSystem,
        stages: Stages,
        bounds: bool,
    ) -> None:
        self._state, self._error, self._estimator = state, error, estimator
        self._system, self._stages, self._comm = system, stages, state.forest.comm
        rows = state.solution.rows
        self._motions = None if rows is None else RowMotions.of(rows, turning=True)
        settles = self._motions is not None and len(self._motions) > 0
        self._tolerances = (_LOOSE, _TIGHT) if bounds and system.exact and not settles else (_TIGHT,)

    @cached_property
    def between(self) -> GapBetweenNodes:
        """The gap between the nodes of the step.  Collective at the first call."""
        return GapBetweenNodes(self._state)

    @cached_property
    def edge(self) -> ContactEdge:
        """The edge of the contact of the step.  Collective at the first call."""
        return ContactEdge(self._state)

    @cached_property
    def _of_obstacles(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """z_v (k, owned, 3), m_v and v, both (k, n), of obstacles that settle.  Collective at the first call."""
        motions, system = self._motions, self._system
        assert motions is not None and isinstance(system, ContactSystem)
        closed = system.springs.closed & system.movable
        guess = np.zeros((len(motions), *self._state.solution.displacement.shape))
        with self._stages("solve"):
            return *sensitivities(system, motions, closed, _TIGHT, guess), np.where(closed, motions.rates, 0.0)

    def of(self, functional: Functional, allowed: float) -> Goal:
        """A quantity of interest and its error.

        Collective.  For the z of a point the products (e_u, e_z)_T of a family have both signs and cancel: the sum of
        |(e_u, e_z)_T| is up to three times as large.  Over larger distances cancellation is not reliable: the sum
        over all cells is 0.01 to 0.6 of the error for a gap beside Hertz's contact.

        Args:
            allowed: error up to which no leaves are refined, and a bound suffices.
        """
        load, penetration = self._data(functional)
        y: FloatArray | None = None
        for tolerance in self._tolerances:
            with self._stages("solve"):
                y, force = self._system.dual(load, penetration, tolerance, y)
            motions, moved = self._motions, None
            if motions is not None and len(motions) and not functional.fixed:
                z, m, rates = self._of_obstacles
                sums = self._comm.allreduce(rates @ np.column_stack([force, m.T]))
                share = -np.linalg.pinv(sums[:, 1:], rcond=_UNRESISTED) @ sums[:, 0]
                y, force, moved = y + np.tensordot(share, z, axes=1), force + share @ m, share @ motions.rates
            goal = self._estimated(functional, y, force, moved)
            bound = goal.total + tolerance * self._error.estimate.error_global * goal.dual.energy_norm
            if tolerance == _LOOSE and bound <= allowed:
                return replace(goal, total=bound)
        return goal

    def _estimated(self, functional: Functional, y: FloatArray, force: FloatArray, moved: FloatArray | None) -> Goal:
        """The error by y = z - w, (owned, 3), forces of z and unknown motions in all rows, the n of contact first."""
        elasticity, pairs = self._state.elasticity, self._state.rows
        z = y if functional.prescribed is None else y + functional.prescribed
        dual = self._estimator.error(elasticity.field(z), loaded=False)
        error = _of_families(elasticity, self._estimator.products(self._error, dual))
        pressure = np.zeros(0) if pairs is None else force[: len(pairs)] / pairs.area
        if pairs is not None:
            error = error + self.between.on_cells(pressure)
            jump = sum(d[: len(pairs)] for d in (functional.beyond, moved) if d is not None) - pairs.jump(z)
            error = error + self.edge.on_cells(np.where(self._state.solution.active, 0.0, jump))
        total = self._comm.allreduce(float(error.sum()))
        return Goal(functional.value, error, total, dual.estimate, z, pressure)

    def _data(self, functional: Functional) -> tuple[FloatArray, FloatArray]:
        """The load (owned, 3) and the jump, in rows of contact and of ties, of the problem of y = z - w.

        K y + B^T m = l - K w, B y = d - B w, and y = 0 at prescribed components.
        """
        elasticity, rows = self._state.elasticity, self._state.solution.rows
        shape = self._state.solution.displacement.shape
        load = np.zeros(shape) if functional.load is None else functional.load
        penetration: FloatArray = np.zeros(0 if rows is None else len(rows))
        w = functional.prescribed
        penetration[: len(functional.penetration)] = functional.penetration
        if functional.tangential is not None and isinstance(self._system, ContactSystem):
            axes = self._system.jump.rows  # along and across the slip
            components = np.einsum("ni,ni->n", functional.tangential, axes.normal)
            penetration = np.where(axes.role == Role.TANGENT, components, penetration)
        if w is not None:
            load = load - elasticity.internal_forces(elasticity.field(w))
            penetration = penetration if rows is None else penetration - rows.jump(w)
        return load, penetration


def gap_functional(state: SolvedState, weight: FloatArray) -> Functional:
    """The mean gap of rows by weights (n,), of sum 1 over all ranks [-].  Collective on state.forest.comm."""
    left = np.maximum(-state.solution.penetration, 0.0)
    value = state.forest.comm.allreduce(float((weight * left).sum()))
    return Functional(value, value, load=-state.contact_rows.transposed(weight))


def _of_families(elasticity: Elasticity, products: FloatArray) -> FloatArray:
    """|sum of the products| of the children of one parent, in equal shares (ncells,); root cells are alone.

    Collective.  A family, perhaps on several ranks, is identified by the middle of the parent: a common corner of the
    children that never hangs.

    Args:
        products: (ncells,), signed, of this rank's cells.
    """
    prolongation, leaf = elasticity.prolongation, elasticity.leaf_mesh.leaf
    space, forest = prolongation.space, prolongation.space.forest
    corner = (1 - forest.anchor[leaf] // leaf_side(forest.level[leaf])[:, None] % 2) @ [1, 2, 4]
    middle = prolongation.conforming[space.cells[leaf, hexahedron.corner_nodes(space.degree)[corner]]]
    alone, sums = forest.level[leaf] == 0, prolongation.zeros(2)
    np.add.at(sums, middle[~alone], np.column_stack([products, np.ones_like(products)])[~alone])
    total, count = prolongation.ghosted(prolongation.summed(sums))[middle].T
    return np.abs(np.divide(total, count, out=products.copy(), where=~alone))
