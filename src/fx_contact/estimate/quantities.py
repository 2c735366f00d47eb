"""Quantities of interest, each with a tolerance of its own beside that of the energy norm."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fx_contact.estimate.dual_weighted import Functional
from fx_contact.estimate.solved_state import SolvedState
from fx_contact.fem.dirichlet import held_nodes, shared_forces
from fx_contact.geometry.point_location import root_cells_at
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.items.boundary_conditions import Dirichlet
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_direction, check_name, check_tolerance, check_vector
from fx_contact.scene.scene import Scene


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
        set_vectors(self, point=self.point, direction=self.direction)
        check_direction("the direction of a Displacement", self.direction)

    @property
    def name(self) -> str:
        """Name in records."""
        of = "" if self.body is None else f" of {self.body}"
        return f"displacement{of} at {listed(self.point)} along {listed(self.direction)}"

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
            set_vectors(self, direction=self.direction)
            check_direction("the direction of a Reaction", self.direction)

    @property
    def name(self) -> str:
        """Name in records."""
        along = "" if self.direction is None else f" along {listed(self.direction)}"
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
        held = held_nodes(state.elasticity.prolongation, scene.conditions)
        shared, w = shared_forces(scene.conditions, held, residual), np.zeros(residual.shape)
        image, vector = scene.mirrors.force(direction), np.zeros_like(direction)
        for nodes, condition in zip(held, scene.conditions):
            if condition.where == self.where:
                vector += condition.across @ shared[nodes].sum(axis=0)
                w[nodes] += condition.across @ image
        w = shared_forces(scene.conditions, held, w)
        vector = scene.mirrors.force(state.forest.comm.allreduce(vector))
        return Functional(float(direction @ vector), float(np.linalg.norm(vector)), prescribed=w)


def set_vectors(quantity: Quantity, **vectors: Sequence[float]) -> None:
    """Set attributes to tuples of three floats.  Local.  Raises SceneError: they are not three finite numbers."""
    for name, vector in vectors.items():
        object.__setattr__(quantity, name, check_vector(f"the {name} of a {type(quantity).__name__}", vector))


def listed(point: Sequence[float]) -> str:
    """Three numbers as part of a name.  Local."""
    return ", ".join(f"{x:.12g}" for x in point)
