"""Quantities of interest of contact pairs: forces, gaps, pressures."""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fx_contact.contact.constraint_rows import ConstraintRows
from fx_contact.contact.pressure import pressure_change
from fx_contact.estimate.dual_weighted import Functional, gap_functional
from fx_contact.estimate.quantities import Quantity, listed, set_vectors
from fx_contact.estimate.solved_state import SolvedState
from fx_contact.items.contact import Contact
from fx_contact.items.friction import Friction
from fx_contact.law.tangents import tangential_vectors
from fx_contact.parallel.arrays import BoolArray, FloatArray
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_direction, check_name
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


class OfPair(Quantity):
    """A quantity of a contact pair, given by itself or by its name, which is what remains."""

    pair: str | Contact

    def __post_init__(self) -> None:
        if isinstance(self.pair, Contact):
            object.__setattr__(self, "pair", self.pair.name)
        super().__post_init__()

    def check(self, scene: Scene) -> None:
        """As `Quantity.check`.  Local.  Raises SceneError: no such contact pair."""
        names = [pair.name for pair in scene.contact]
        reversed_name = " on ".join(str(self.pair).split(" on ")[::-1])
        if self.pair not in names and reversed_name in names:
            raise SceneError(f"unknown contact pair {self.pair!r}; did you mean {reversed_name!r}?")
        check_name("contact pair", self.pair, names)

    def contact(self, scene: Scene) -> Contact:
        """The contact pair.  Local."""
        return next(pair for pair in scene.contact if pair.name == self.pair)

    def rows(self, state: SolvedState) -> tuple[ConstraintRows, BoolArray]:
        """All rows, and those of the contact pair as a mask (n,).  Local."""
        return state.contact_rows, np.asarray(state.contact_rows.contact == self.index(state.scene))

    def index(self, scene: Scene) -> int:
        """Of the contact pair among `Scene.interfaces`.  Local."""
        return [interface.name for interface in scene.interfaces].index(self.contact(scene).name)


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
class FrictionForce(OfPair):
    """The tangential force of a contact pair with friction, on its second side or obstacle, in a direction.

    Attributes:
        pair: of the scene, or its name, "first on second".
        direction: (3,), of any length.
        tolerance: allowed error relative to the sum of the bounds of the tangential forces, as mu times the normal ones
            [-].

    Raises:
        SceneError: a tolerance as of `Quantity`, or the direction not three numbers or zero.
    """

    pair: str | Contact
    direction: tuple[float, float, float]
    tolerance: float

    def __post_init__(self) -> None:
        super().__post_init__()
        set_vectors(self, direction=self.direction)
        check_direction("the direction of a FrictionForce", self.direction)

    @property
    def name(self) -> str:
        """Name in records."""
        return f"friction force of {self.pair} along {listed(self.direction)}"

    def check(self, scene: Scene) -> None:
        """As `Quantity.check`.  Raises SceneError also for a contact pair without friction."""
        super().check(scene)
        if not isinstance(self.contact(scene).tangential, Friction):
            raise SceneError(f"{self.contact(scene).label} has no friction, and {self!r} is 0")

    def functional(self, state: SolvedState, residual: FloatArray) -> Functional:
        """As `Quantity.functional`.  Raises SceneError: as `check`, of a scene that was not checked."""
        solution, scene, (_, ours), index = state.solution, state.scene, self.rows(state), self.index(state.scene)
        every = solution.rows
        assert every is not None
        # The rows may have the surfaces in the other order.
        sign = 1.0 if scene.oriented[index] is scene.interfaces[index] else -1.0
        force = sign * np.where(ours[:, None], tangential_vectors(every, solution.row_force), 0.0)
        vector = scene.mirrors.force(state.forest.comm.allreduce(force.sum(axis=0)))
        direction = check_direction("", self.direction)
        image, size = scene.mirrors.force(direction), np.linalg.norm(force, axis=1)
        law, derivative, closed = self.contact(scene).tangential, np.zeros(len(force)), ours & solution.active
        assert isinstance(law, Friction)
        slips = solution.slipping & (size > 0)
        normals = solution.force, every.area[: len(ours)]
        derivative = law.derivative(*normals) * np.divide(force @ image, size, out=derivative, where=slips)
        bounds = scene.symmetry * law.bounds(*normals)[closed].sum()
        along = np.where((every.contact == index)[:, None], sign * image, 0.0)
        most = state.forest.comm.allreduce(float(bounds))
        return Functional(float(direction @ vector), most, penetration=derivative, tangential=along)


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
        set_vectors(self, point=self.point)

    @property
    def name(self) -> str:
        """Name in records."""
        return f"gap of {self.pair} at {listed(self.point)}"

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
        local = np.where(ours, np.maximum(solution.pressure + change - value, 0.0), 0.0)
        return Functional(value, value, penetration=np.where(solution.active, share, 0.0), local=local)


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
