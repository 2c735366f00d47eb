"""Quantities of interest, each with a tolerance of its own beside that of the energy norm."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fx_contact.contact.constraint_rows import ConstraintRows
from fx_contact.contact.pressure import pressure_change
from fx_contact.estimate.dual_weighted import Functional, gap_functional
from fx_contact.estimate.solved_state import SolvedState
from fx_contact.fem.dirichlet import held_nodes, shared_forces
from fx_contact.geometry.point_location import root_cells_at
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.items.boundary_conditions import Dirichlet
from fx_contact.items.contact import Contact
from fx_contact.parallel.arrays import BoolArray, FloatArray
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_direction, check_name, check_tolerance, check_vector
from fx_contact.scene.scene import Scene

#: Relative differences of equal distances and pressures: rounding, and the error of the linear solver.
_SAME = 1e-6
#: Pressures from this part of the largest one on are averaged [-].  Estimated over true errors of `studies.goals.run`
#: (scenes hertz at 10 and 5 %, rounded punch at 5, 4 and 3 %, line contact at 5 and 2 %) with
#:
#:     0.95    2.7, 3.8    11, 1.4, 5.4     9.1, 2.5
#:     0.8     3.0, 3.7    5.5, 0.8, 4.6    10, 2.5
#:     0.5     3.9, 3.5    5.5, 0.8, 3.3    10, 3.1
_NEAR_LARGEST = 0.5


class Quantity(ABC):
    """A quantity of interest; each kind is a frozen dataclass, hashable, with a relative `tolerance` [-].

    Raises:
        SceneError: the tolerance is no number from `LEAST_TOLERANCE` to below 1.
    """

    tolerance: float

    def __post_init__(self) -> None:
        check_tolerance(f"the tolerance of {self!r}", self.tolerance)

    @property
    @abstractmethod
    def name(self) -> str:
        """Name in records."""

    @abstractmethod
    def check(self, scene: Scene) -> None:
        """Check that the scene has the place of the quantity.  Local.  Raises SceneError: it has not."""

    @abstractmethod
    def functional(self, state: SolvedState, residual: FloatArray) -> Functional:
        """The quantity at a solution, by the `nodal_residual` (owned, 3) [N].  Collective on state.forest.comm."""


class OfPair(Quantity):
    """A quantity of a contact pair, given by itself or by its name, which is what remains."""

    pair: str | Contact

    def __post_init__(self) -> None:
        if isinstance(self.pair, Contact):
            object.__setattr__(self, "pair", self.pair.name)
        super().__post_init__()

    def check(self, scene: Scene) -> None:
        """As `Quantity.check`.  Local.  Raises SceneError: no such contact pair."""
        check_name("contact pair", self.pair, [pair.name for pair in scene.contact])

    def contact(self, scene: Scene) -> Contact:
        """The contact pair.  Local."""
        return next(pair for pair in scene.contact if pair.name == self.pair)

    def rows(self, state: SolvedState) -> tuple[ConstraintRows, BoolArray]:
        """All rows, and those of the contact pair as a mask (n,).  Local."""
        assert state.rows is not None
        index = [interface.name for interface in state.scene.interfaces].index(self.contact(state.scene).name)
        return state.rows, np.asarray(state.rows.contact == index)


@dataclass(frozen=True)
class ContactForce(OfPair):
    """The force of a contact pair, as in `StepRecord.pair_forces`.

    That on an obstacle that settles under a force is known: its error is that at a fixed place of the obstacle, the
    error of the distance in `StepRecord.motions` times the stiffness.

    Attributes:
        pair: of the scene, or its name, "first on second".
        tolerance: allowed error relative to the force [-].
    """

    pair: str | Contact
    tolerance: float

    @property
    def name(self) -> str:
        """Name in records."""
        return f"force of {self.pair}"

    def functional(self, state: SolvedState, residual: FloatArray) -> Functional:
        """As `Quantity.functional`."""
        scene, (rows, ours) = state.scene, self.rows(state)
        whole = scene.symmetry * np.where(ours, rows.force_components(np.ones(len(ours))), 0.0)
        share = np.where(state.solution.active, whole, 0.0)
        value = state.forest.comm.allreduce(float(share @ state.solution.force))
        fixed = self.contact(scene).force is not None
        return Functional(value, abs(value), penetration=share, fixed=fixed, beyond=whole)


@dataclass(frozen=True)
class Gap(OfPair):
    """The gap left at a node pair, along the normal; 0 where it is closed.

    Attributes:
        pair: of the scene, or its name, "first on second".
        point: (3,), near the node pair, undeformed, on the first surface [m].
        tolerance: allowed error relative to the gap [-].

    Raises:
        SceneError: a tolerance as of `Quantity`, or a point that is not three numbers.
    """

    pair: str | Contact
    point: tuple[float, float, float]
    tolerance: float

    def __post_init__(self) -> None:
        super().__post_init__()
        _set_vectors(self, point=self.point)

    @property
    def name(self) -> str:
        """Name in records."""
        return f"gap of {self.pair} at {_listed(self.point)}"

    def check(self, scene: Scene) -> None:
        """As `Quantity.check`.  Raises SceneError also for a point farther from all corners than a facet is large."""
        super().check(scene)
        pair = self.contact(scene)
        corners = scene.mesh.facet_points(scene.mesh.surface(pair.surfaces[0]), order=1)
        nearest = np.linalg.norm(corners - np.array(self.point), axis=2).min()
        largest = np.linalg.norm(np.ptp(corners, axis=1), axis=1).max()
        if nearest > largest:
            raise SceneError(
                f"the point of {self!r} is {nearest:.3g} away from the nodes of {pair.surfaces[0]!r}, whose facets are "
                f"up to {largest:.3g} large: take an undeformed point on this surface, and check its units"
            )

    def functional(self, state: SolvedState, residual: FloatArray) -> Functional:
        """As `Quantity.functional`."""
        rows, ours = self.rows(state)
        distance = np.asarray(np.linalg.norm(rows.position - np.array(self.point, np.float64), axis=1))
        weight = _one(state.forest.comm, rows, ours, -distance)
        return gap_functional(state, np.where(state.solution.active, 0.0, weight))


@dataclass(frozen=True)
class MaxPressure(OfPair):
    """The largest nodal contact pressure p of a contact pair.

    p = P + (p - P) with the mean P of the pressures above p / 2: the error of P by an adjoint solution, that of the
    rest by the change of the nodal pressures by D^-1 M (`contact.pressure`).  At sharp edges the pressure is infinite.

    Attributes:
        pair: of the scene, or its name, "first on second".
        tolerance: allowed error relative to the pressure [-].
    """

    pair: str | Contact
    tolerance: float

    @property
    def name(self) -> str:
        """Name in records."""
        return f"largest pressure of {self.pair}"

    def functional(self, state: SolvedState, residual: FloatArray) -> Functional:
        """As `Quantity.functional`."""
        solution, (rows, ours) = state.solution, self.rows(state)
        value = state.forest.comm.allreduce(float(solution.pressure[ours].max(initial=0.0)), op=MPI.MAX)
        near = ours & solution.active & (solution.pressure >= _NEAR_LARGEST * value)
        area = np.where(near, rows.area, 0.0)
        weight = area / (state.forest.comm.allreduce(float(area.sum())) or 1.0)
        share = rows.pressure_weights(solution.force, weight)
        change = np.abs(pressure_change(rows, solution.pressure))
        return Functional(
            value,
            value,
            penetration=np.where(solution.active, share, 0.0),
            local=np.where(ours, np.maximum(solution.pressure + change - value, 0.0), 0.0),
        )


@dataclass(frozen=True)
class Displacement(Quantity):
    """The displacement of a point in a direction.

    Attributes:
        point: (3,), undeformed, in a body or on its surface, in the modelled part [m].
        direction: (3,), of any length.
        tolerance: allowed error relative to the length of the displacement [-].
        body: name, if several bodies have the point.

    Raises:
        SceneError: a tolerance as of `Quantity`, point or direction not three numbers, or the direction zero.
    """

    point: tuple[float, float, float]
    direction: tuple[float, float, float]
    tolerance: float
    body: str | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        _set_vectors(self, point=self.point, direction=self.direction)
        check_direction("the direction of a Displacement", self.direction)

    @property
    def name(self) -> str:
        """Name in records."""
        of = "" if self.body is None else f" of {self.body}"
        return f"displacement{of} at {_listed(self.point)} along {_listed(self.direction)}"

    def check(self, scene: Scene) -> None:
        """As `Quantity.check`: exactly one body has the point."""
        self._place(scene.mesh)

    def functional(self, state: SolvedState, residual: FloatArray) -> Functional:
        """As `Quantity.functional`.  Raises SceneError: as `check`, of a scene that was not checked."""
        comm, prolongation = state.forest.comm, state.elasticity.prolongation
        nodes, values = prolongation.space.functions_at(*self._place(state.scene.mesh))
        sums = np.zeros((len(prolongation.space), 1))
        sums[nodes, 0] = values
        weight = prolongation.restrict(sums)
        vector = comm.allreduce((weight * state.solution.displacement).sum(axis=0))
        direction = check_direction("the direction", self.direction)
        return Functional(float(direction @ vector), float(np.linalg.norm(vector)), load=weight * direction)

    def _place(self, mesh: RootMesh) -> tuple[int, FloatArray]:
        """Root cell and reference coordinates (3,) of the point."""
        if self.body is not None:
            check_name("body", self.body, mesh.bodies, "the root mesh has")
        cells, coordinates = root_cells_at(mesh, np.array(self.point, np.float64))
        bodies = [mesh.bodies[body] for body in mesh.body[cells]]
        found = sorted({*bodies} if self.body is None else {*bodies} & {self.body})
        if not found:
            missed = "in no body" if self.body is None else f"not in {self.body!r}"
            raise SceneError(f"the point of {self!r} is {missed}")
        if len(found) > 1:
            both = " and ".join(map(repr, found))
            raise SceneError(f"the point of {self!r} is in {both}: name one of them as `body`")
        first = bodies.index(found[0])
        return int(cells[first]), coordinates[first]


@dataclass(frozen=True)
class Reaction(Quantity):
    """The reaction of a condition on the bodies, in a direction, as in `StepRecord.resultants`.

    Attributes:
        where: the condition, or its place; all conditions there act together.
        tolerance: allowed error relative to the length of the reaction [-].
        direction: (3,), of any length; None: that of the only prescribed component.

    Raises:
        SceneError: a tolerance as of `Quantity`, or the direction not three numbers or zero.
    """

    where: str | Dirichlet
    tolerance: float
    direction: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if isinstance(self.where, Dirichlet):
            object.__setattr__(self, "where", self.where.where)
        super().__post_init__()
        if self.direction is not None:
            _set_vectors(self, direction=self.direction)
            check_direction("the direction of a Reaction", self.direction)

    @property
    def name(self) -> str:
        """Name in records."""
        along = "" if self.direction is None else f" along {_listed(self.direction)}"
        return f"reaction at {self.where}{along}"

    def check(self, scene: Scene) -> None:
        """As `Quantity.check`: there is such a condition, and it prescribes the direction."""
        self._unit_direction(scene)

    def _unit_direction(self, scene: Scene) -> FloatArray:
        """The direction as a unit vector (3,)."""
        conditions = [condition for condition in scene.dirichlet if isinstance(condition, Dirichlet)]
        check_name("condition", self.where, [condition.where for condition in conditions])
        held = np.any([condition.held for condition in conditions if condition.where == self.where], axis=0)
        if self.direction is None and held.sum() > 1:
            raise SceneError(f"{self.where!r} is held in several directions: give {self!r} one")
        direction = held.astype(float) if self.direction is None else check_direction("", self.direction)
        if not (held * direction).any():
            raise SceneError(f"{self.where!r} is not held along the direction of {self!r}: it has no reaction there")
        return direction

    def functional(self, state: SolvedState, residual: FloatArray) -> Functional:
        """As `Quantity.functional`; conditions of one node share its reaction."""
        scene, direction = state.scene, self._unit_direction(state.scene)
        held = held_nodes(scene, state.elasticity.prolongation)
        shared, w = shared_forces(scene.conditions, held, residual), np.zeros(residual.shape)
        image, vector = scene.mirrors.force(direction), np.zeros_like(direction)
        for nodes, condition in zip(held, scene.conditions):
            if condition.where == self.where:
                vector += condition.across @ shared[nodes].sum(axis=0)
                w[nodes] += condition.across @ image
        w = shared_forces(scene.conditions, held, w)
        vector = scene.mirrors.force(state.forest.comm.allreduce(vector))
        return Functional(float(direction @ vector), float(np.linalg.norm(vector)), prescribed=w)


def _set_vectors(quantity: Quantity, **vectors: Sequence[float]) -> None:
    """Set attributes to tuples of three floats.  Raises SceneError: they are not three finite numbers."""
    for name, vector in vectors.items():
        check_vector(f"the {name} of a {type(quantity).__name__}", vector)
        object.__setattr__(quantity, name, tuple(map(float, vector)))


def _listed(point: Sequence[float]) -> str:
    """Three numbers as part of a name."""
    return ", ".join(f"{x:.12g}" for x in point)


def _one(comm: MPI.Intracomm, rows: ConstraintRows, some: BoolArray, value: FloatArray) -> FloatArray:
    """Weights (n,): 1 for the row with the largest value among some, if any; of equal ones the first by position."""
    weight, ours = np.zeros(len(rows)), np.flatnonzero(some)
    largest = comm.allreduce(float(value[ours].max(initial=-np.inf)), op=MPI.MAX)
    if not np.isfinite(largest):
        return weight
    near = ours[value[ours] >= largest - _SAME * abs(largest)]
    first = min(comm.allgather(min(map(tuple, rows.position[near]), default=(np.inf,) * 3)))
    weight[near[(rows.position[near] == first).all(axis=1)]] = 1.0
    return weight
