"""Quantities of interest: their estimated errors against known ones, and tolerances of their own."""

import re
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import EXACT
from mpi4py import MPI

from demos.hertz_reference import REFERENCES
from fx_contact import (
    ContactForce,
    Dirichlet,
    Displacement,
    Enforcement,
    ErrorControl,
    Gap,
    Material,
    MaxPressure,
    Reaction,
    Scene,
    SceneError,
    Tie,
    adapt,
    block,
    root_mesh_from_shapes,
    solve,
)
from fx_contact.adaptive.step_record import StepRecord
from fx_contact.contact.enforcement import METHODS
from fx_contact.estimate import goal_errors
from fx_contact.estimate.dual_weighted import Functional, _of_families, gap_functional
from fx_contact.estimate.estimator import Estimator
from fx_contact.estimate.goal_errors import judge_goals
from fx_contact.estimate.quantities import Quantity
from fx_contact.estimate.shear_free import find_shear_free
from fx_contact.parallel.timing import Stages
from fx_contact.scenes import hertz, indentation, stack
from studies.goals.run import layers, square

POLES = "lower pole on upper pole"
BLOCKS = "on block 0 on under block 1"
#: A tolerance that says nothing: the error alone is wanted.
ANY = 0.999


def once(scene, goals, comm=WORLD, **options):
    """Goals and resultants of the first mesh, which meets the tolerance of the energy by the control of the paper."""
    options = {"degree": 1, "control": ErrorControl("energy"), "solver": EXACT} | options
    return solve(scene, 0.95, comm, goals=goals, max_steps=1, **options).record


def test_effectivity_at_degree_2():
    """Hertz: errors of force, reaction, largest pressure, a gap and a displacement, 0.5 to 10 times the true ones."""
    beside, inside = Gap(POLES, (0.2, 0.0, 0.0), ANY), Displacement((0.0, 0.0, 0.5), (0, 0, -1), ANY)
    force, pressure, reaction = ContactForce(POLES, 0.05), MaxPressure(POLES, 0.1), Reaction("top", 0.05)
    known, scene = REFERENCES["hertz-a"](), hertz(order=6, coarse=2)
    record = solve(scene, 0.1, goals=(force, reaction, pressure, beside, inside)).record
    finer = 0.0297665, 0.00464596  # this program's at 1 % (`studies/goals/table.csv`)
    assert record.reached and all(goal.reached for goal in record.goals)
    assert abs(record.goals[0].value / record.force - 1) < 1e-12
    values = known.force, -known.force, known.max_pressure, *finer
    for goal, true in zip(record.goals, values):
        assert 0.5 < goal.error / abs(goal.value - true) < 10, goal


def test_a_goal_is_refined_for():
    """With the energy met, the force of a contact pair is held to a tolerance of its own, on 1, 2 and 3 ranks alike."""
    goal = ContactForce(POLES, 0.01)
    *_, before, last = (step.record for step in adapt(hertz(order=3, coarse=2), 0.3, degree=1, goals=(goal,)))
    assert before.estimate < 0.3 and not before.reached and before.goals[0].error > 0.01 * before.force
    assert last.reached and last.goals[0].reached and last.goals[0].error <= 0.01 * last.force
    assert StepRecord.from_json(last.as_json()).goals == last.goals


def test_the_load_of_a_gap_is_its_derivative():
    """A displacement changes the mean gap of open pairs by its product with the load."""
    step = next(adapt(hertz(order=3, coarse=2), 0.3, max_steps=1))
    weight = np.where(step.solution.active, 0.0, step.rows.area)
    change = 1e-3 * np.sin(np.arange(step.solution.displacement.size)).reshape(-1, 3)
    load = gap_functional(step, weight).load
    ends = WORLD.allreduce(np.array([weight @ step.rows.jump(change), (load * change).sum()]))
    assert ends[0] != 0 and abs(ends[0] + ends[1]) < 1e-10 * abs(ends[0])


class Leaves(list):
    """What of a forest is asked for: its communicator, and so many leaves on each rank."""

    comm = WORLD

    def __init__(self, count):
        super().__init__(range(count))


@pytest.mark.parametrize("theta, marked", [(1.0, 0), (0.61, 0), (0.59, 1), (0.1, 2)])
def test_an_error_is_corrected_by_the_effectivity(theta, marked, monkeypatch):
    """Of 2 N, 0.2 N may be wrong; 0.12 N are estimated, most of them of one cell."""
    leaf, errors = np.arange(4), np.array([0.1, 0.01, 0.009, 0.001]) / WORLD.size
    state = SimpleNamespace(forest=Leaves(4), elasticity=SimpleNamespace(leaf_mesh=SimpleNamespace(leaf=leaf)))
    dual = SimpleNamespace(relative=0.1, child_error=1 / 32)
    found = SimpleNamespace(dual=dual, error=errors, total=WORLD.allreduce(errors.sum()))
    functional = Functional(2.0, 2.0, penetration=np.ones(1))
    monkeypatch.setattr(ContactForce, "functional", lambda *_: functional)
    (judged,) = judge_goals(
        (ContactForce("force", 0.1),), SimpleNamespace(of=lambda *_: found), state, None, theta, ErrorControl()
    )
    record, times = judged.record, judged.refine
    assert (record.value, record.reached) == (2.0, marked == 0) and abs(record.error - 0.12 / theta) < 1e-12
    everywhere(np.count_nonzero(times) == marked, f"{times}")
    assert judged.leaves == marked * WORLD.size


def test_local_errors_add_to_that_of_the_mean(monkeypatch):
    """Of 2 Pa, 0.2 may be wrong; 0.04 of the mean and up to 0.9 of nodes, of which 0.1 (by 0.5) is aimed at."""
    state = SimpleNamespace(
        forest=Leaves(4), elasticity=SimpleNamespace(leaf_mesh=SimpleNamespace(leaf=np.arange(4)))
    )
    state.contact_rows = state.forest
    found = SimpleNamespace(dual=SimpleNamespace(child_error=1 / 32), error=np.zeros(4), total=0.04)
    last = WORLD.rank == WORLD.size - 1
    local = np.array([0.9, 0.3, 0.05, 0.0]) * last
    functional = Functional(2.0, 2.0, penetration=np.ones(1), local=local)
    monkeypatch.setattr(ContactForce, "functional", lambda *_: functional)
    monkeypatch.setattr(goal_errors, "leaves_of_rows", lambda _, chosen: np.flatnonzero(chosen))
    duals, control = SimpleNamespace(of=lambda *_: found), ErrorControl()
    (judged,) = judge_goals((ContactForce("pressure", 0.1),), duals, state, None, 1.0, control)
    assert judged.record.error == pytest.approx(0.94) and not judged.record.reached
    assert 0.05 < 0.16 * control.target < 0.9 / 4 and judged.leaves == 2
    everywhere((judged.refine == (np.array([2, 1, 0, 0]) if last else 0)).all(), f"{judged.refine}")


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("degree", [1, 2])
def test_values_of_a_stack(method, degree):
    """Linear displacements are exact on any mesh: values by hand, and no error, but for what a penalty yields."""
    top = 1.7, -0.017  # of three blocks under 1 % of strain
    point = Displacement((0.3, 0.21, top[0]), (0, 0, -2), ANY)
    goals = ContactForce(BLOCKS, ANY), Reaction("bottom", ANY), MaxPressure(BLOCKS, ANY), point
    record = once(stack(pressure=0.01, side=2.0), goals, degree=degree, enforcement=Enforcement(method))
    for goal, value in zip(record.goals, (0.04, 0.04, 0.01, -top[1])):
        close = 0.01 if method == "penalty" and goal.name == point.name else 1e-6
        assert abs(goal.value / value - 1) < close and goal.error < 1e-6 * value


def test_what_is_prescribed_has_no_error():
    """The displacement of a held point, which has a dual solution of 0, and a gap that is closed, which has none."""
    held, closed = Displacement((0.1, 0.2, 3.0), (0, 0, 1), 1e-6), Gap(BLOCKS, (0, 0, 1), 1e-6)
    record = once(stack(), (held, closed))
    assert [goal.value for goal in record.goals] == pytest.approx([-0.01, 0.0], abs=1e-15)
    assert [goal.error for goal in record.goals] == [0.0, None] and all(goal.reached for goal in record.goals)


def test_reaction_and_contact_force():
    """They balance each other, and so do their adjoint solutions: the errors are the same."""
    asked = ContactForce(POLES, ANY), Reaction("top", ANY), Reaction("top", ANY, (3, 0, 4))
    force, top, aside = once(hertz(order=2, coarse=2), asked).goals
    assert force.value > 0 and abs(force.value + top.value) < 1e-9 * force.value
    assert abs(force.error / top.error - 1) < 1e-3  # the tolerance of the adjoint solutions is 1e-6
    assert abs(aside.value / top.value - 0.8) < 1e-9 and abs(aside.error / top.error - 0.8) < 1e-3
    assert aside.allowed == pytest.approx(ANY * abs(top.value))


def test_error_of_a_contact_force():
    """With goals of the user there is one estimate for one force, without them a bound of it."""
    scene, options = hertz(order=3, coarse=2), {"tolerance": 0.1}
    plain = solve(scene, **options).record
    asked = solve(scene, goals=(Reaction("top", ANY), ContactForce(POLES, ANY)), **options).record
    assert plain.cells == asked.cells and plain.reached
    reaction, force = asked.goals
    assert reaction.error == pytest.approx(force.error, rel=1e-3)
    assert force.error == pytest.approx(asked.pair_errors[0] * asked.force, rel=1e-12)
    assert 1.05 < plain.pair_errors[0] / asked.pair_errors[0] < 3


@dataclass(frozen=True)
class Rise(Quantity):
    """A quantity of the user: the displacement of a point, upwards."""

    point: tuple
    tolerance: float
    name = "rise"

    def check(self, scene):
        self._upwards.check(scene)

    @property
    def _upwards(self):
        return Displacement(self.point, (0, 0, 1), self.tolerance)

    def functional(self, state, residual):
        return self._upwards.functional(state, residual)


def test_a_quantity_of_the_user():
    """A subclass of Quantity is a goal as those of the package are."""
    point = (0.3, 0.21, 0.5)
    own, known = once(stack(pressure=0.01), (Rise(point, ANY), Displacement(point, (0, 0, 1), ANY))).goals
    assert own.name == "rise" and own.value == known.value < 0 and own.error == pytest.approx(known.error)


def test_goals_that_differ_in_the_last_digits():
    """Each has its own value; points may be arrays."""
    far = 1e6
    bar = block((far, 0, 0), (far + 2, 1, 1), (2, 1, 1), 1)
    held, pulled = Dirichlet("block left", x=0.0, y=0.0, z=0.0), Dirichlet("block right", x=0.02, y=0.0, z=0.0)
    materials = {"block": Material(1.0, 0.0)}
    scene = Scene("bar", root_mesh_from_shapes({"block": bar}), materials, (held, pulled))
    points = np.array([[far + 1, 0.5, 0.5], [far + 2, 0.5, 0.5]])
    record = solve(scene, 0.9, goals=[Displacement(point, (1, 0, 0), ANY) for point in points]).record
    assert [goal.value for goal in record.goals] == pytest.approx([0.01, 0.02], rel=1e-6)
    assert len({goal.name for goal in record.goals}) == 2


def test_reaction_shared_by_conditions():
    """Two conditions on one place have half of its reaction each, as in the resultants; a Reaction is of the place."""
    scene = stack()
    twice = replace(scene, dirichlet=(*scene.dirichlet, Dirichlet("top", z=-0.01)))
    (one,), (both,) = (once(s, (Reaction("top", ANY),)).goals for s in (scene, twice))
    assert abs(both.value / one.value - 1) < 1e-9


@pytest.mark.parametrize("make", [lambda **k: hertz(coarse=2, order=2, **k), lambda **k: indentation(coarse=2, **k)])
def test_quarter_and_full_model(make):
    """Values are those of the whole, whatever is modelled, and errors of what is symmetric."""
    quarter, full = make(symmetry="quarter"), make(symmetry="full")
    (pair,) = (pair.name for pair in quarter.contact)
    goals = ContactForce(pair, ANY), Reaction("top", ANY), MaxPressure(pair, ANY)
    for one, other in zip(once(quarter, goals).goals, once(full, goals).goals):
        assert abs(one.value / other.value - 1) < 1e-6
        assert abs(one.error / other.error - 1) < 1e-3 or (one.name, pair) == (goals[2].name, "footprint on base")


@pytest.mark.ranks(2, 3)
def test_same_on_any_number_of_ranks():
    """What all ranks find together is what one finds alone, where families of cells are cut too."""
    point = Displacement((0.1, 0.2, 0.6), (1, 2, 3), ANY)
    goals = (
        ContactForce(POLES, ANY),
        MaxPressure(POLES, ANY),
        Reaction("top", ANY),
        Gap(POLES, (0.2, 0, 0), ANY),
        point,
    )
    options = {"degree": 1, "goals": goals, "partition_kind": "sfc", "solver": EXACT}
    alone, together = (
        solve(hertz(order=2, coarse=2), 0.6, comm, **options).record for comm in (MPI.COMM_SELF, WORLD)
    )
    assert alone.step == together.step > 0 and alone.cells == together.cells
    for one, other in zip(alone.goals, together.goals):
        assert one.error and one.reached and other.reached
        assert abs(one.value / other.value - 1) < 1e-7 and abs(one.error / other.error - 1) < 1e-3


@pytest.mark.parametrize("degree", [1, 2])
def test_products(degree):
    """(e_u, e_u)_T = xi_T^2, |(e_u, e_z)_T| <= xi_T(u) xi_T(z), symmetric; families have equal shares of their sums."""
    step = solve(hertz(order=2, coarse=2), 0.6, degree=degree)
    elasticity, forest, u = step.elasticity, step.forest, step.solution.displacement
    estimator = Estimator(elasticity, find_shear_free(step.scene, forest, elasticity.prolongation), Stages())
    position = elasticity.prolongation.injected(elasticity.prolongation.space.positions())
    one, other = (estimator.error(elasticity.field(v)) for v in (u, 1e-3 * np.sin(9 * position)))
    squares, products = estimator.products(one, one), estimator.products(one, other)
    bound = one.estimate.error * other.estimate.error
    everywhere((np.abs(squares - one.estimate.error**2) <= 1e-9 * squares.max(initial=0.0)).all(), "another square")
    everywhere((np.abs(products) <= (1 + 1e-9) * bound).all(), "more than Cauchy and Schwarz allow")
    turned = estimator.products(other, one)
    everywhere(np.allclose(products, turned, rtol=1e-9, atol=1e-12 * bound.max()), "asymmetric")
    shares = _of_families(elasticity, squares)
    assert WORLD.allreduce(shares.sum()) == pytest.approx(one.estimate.error_global**2)
    assert (_of_families(elasticity, np.ones_like(products)) == 1).all() and (forest.level > 0).any()


@pytest.mark.parametrize("degree", [1, 2])
def test_the_mean_of_large_pressures_is_a_functional_of_the_forces(degree):
    """w . p = d . f; for other forces too, where pressures vary too little for the limit of their changes."""
    step = solve(hertz(order=6, coarse=2), 0.3, degree=degree)
    pairs, force, functional = step.rows, step.solution.force, MaxPressure(POLES, ANY).functional(step, None)
    assert functional.value == step.record.max_pressure
    large = np.where(step.solution.pressure >= functional.value / 2, pairs.area, 0.0)
    ends = [large @ step.solution.pressure, large.sum(), functional.penetration @ force]
    load, area, mean = WORLD.allreduce(np.array(ends))
    assert abs(mean / load * area - 1) < 1e-12 and 0.5 * functional.value < mean < 0.9 * functional.value
    weight = np.cos(7 * pairs.position @ [1.0, 2.0, 3.0])
    even = [pairs.area * (1 + 0.01 * np.sin(k * pairs.position[:, 0])) for k in (9, 19)]
    weights = pairs.pressure_weights(even[0], weight)
    for smooth in even:
        one, other = WORLD.allreduce(np.array([weight @ pairs.pressure(smooth), weights @ smooth]))
        assert abs(one / other - 1) < 1e-12
    alternating = WORLD.allreduce(float(np.abs(weights * pairs.area - weight).sum()))
    assert (alternating > 1e-3) == (degree == 2)


def test_the_largest_pressure_is_refined_for():
    """Hertz: where the energy is met it is off by several times what is asked for; then it is right to that.

    The energy is met on cells wider than the contact radius: of a quarter four nodes are closed.
    """
    known, goal = REFERENCES["hertz-a"]().max_pressure, MaxPressure(POLES, 0.03)
    steps = [step.record for step in adapt(hertz(order=6, coarse=2), 0.5, goals=(goal,))]
    first, *_, last = estimated = [record for record in steps if record.goals[0].error is not None]
    off = [abs(record.max_pressure - known) for record in estimated]
    assert first.estimate < 0.5 and off[0] > 3 * goal.tolerance * known and not first.reached
    assert last.reached and off[-1] < last.goals[0].error <= goal.tolerance * last.max_pressure
    assert all(error < record.goals[0].error for error, record in zip(off, estimated))


def test_displacement_of_a_half_space():
    """Boussinesq: below a square pressure, in the middle and aside; a block that moves on its faces as it must."""
    scene, goals = square()
    (middle, known), (aside, far) = goals.values()
    asked = replace(middle, tolerance=0.002), replace(aside, tolerance=0.002)
    record = solve(scene, 0.3, goals=asked).record
    assert record.reached and record.goals[0].error > abs(record.goals[0].value - known)
    assert re.fullmatch(
        r"displacement at 0, 0, 0 along 0, 0, -1: 0.00204\d+, estimated error 0.\d+%, tolerance 0.2% reached",
        str(record.goals[0]),
    )
    for goal, value in zip(record.goals, (known, far)):
        assert abs(goal.value / value - 1) < 0.002 and goal.error <= goal.allowed


def test_gap_at_the_rim_of_receding_layers():
    """At an energy error of 30 % it is 12 % off; asked for to 2 %, it is right to that."""
    scene, goals = layers()
    gap, _ = goals["gap at the rim"]
    first, *_, last = (step.record for step in adapt(scene, 0.3, goals=(replace(gap, tolerance=0.02),)))
    known = 4.4811e-3  # this program's at 0.5 %, 97,092 unknowns
    assert abs(first.goals[0].value / known - 1) > 0.1 and first.estimate < 0.3 and not first.reached
    assert last.reached and abs(last.goals[0].value / known - 1) < 0.02


def test_an_item_or_its_name():
    """Goals of a contact pair and of a condition take the object itself; a tie has none."""
    scene, point = stack(), (0, 0, 0)
    (pair, other), condition = scene.contact, scene.dirichlet[0]
    assert ContactForce(pair, 0.1) == ContactForce(pair.name, 0.1)
    assert Gap(other, point, 0.1) == Gap(other.name, point, 0.1)
    assert MaxPressure(pair, 0.1) == MaxPressure(pair.name, 0.1)
    assert Reaction(condition, 0.1) == Reaction(condition.where, 0.1)
    for goal in (ContactForce(pair, 0.1), Reaction(condition, 0.1)):
        goal.check(scene)
    with pytest.raises(SceneError, match="unknown contact pair 'a tied to b'"):
        ContactForce(Tie("a", "b"), 0.1).check(scene)


def test_no_goals_no_record():
    assert solve(hertz(order=2, coarse=2), 0.6, degree=1).record.goals == ()


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: "force", "must be a tuple"),
        (lambda: ("force",), "must be one of ContactForce, FrictionForce, Gap"),
        (lambda: (Reaction("x = 0", 0.1),), "unknown condition 'x = 0'"),  # a plane of symmetry
        (lambda: (Reaction("top", 0.1, (1, 0, 0)),), "is not held along"),
        (lambda: (Displacement((0, 0, 0), (0, 0, 1), 0.1),), "in 'lower' and 'upper': name"),
        (lambda: (Displacement((0, 0, 1), (0, 0, 1), 0.1, "lower"),), "is not in 'lower'"),
        (lambda: Displacement((0, 0, np.nan), (0, 0, 0), 0.1), "must be a finite number"),
    ],
)
def test_bad_goals(make, words):
    with pytest.raises(SceneError, match=words):
        adapt(hertz(order=2, coarse=2), 0.5, goals=make())


def test_a_reaction_needs_one_direction():
    scene = stack()
    scene = replace(scene, dirichlet=(*scene.dirichlet, Dirichlet("bottom", x=0.0)))
    with pytest.raises(SceneError, match="in several directions"):
        adapt(scene, 0.5, goals=(Reaction("bottom", 0.1),))
