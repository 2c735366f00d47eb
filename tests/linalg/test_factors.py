"""Cholesky factors by cost: below p-multigrid where they are cheap, in its place once a solve has cost as much."""

import numpy as np
import pytest
from conftest import WORLD, everywhere
from mpi4py import MPI

from fx_contact import Dirichlet, Material, Scene, Solver, Traction, adapt
from fx_contact.linalg import ladder
from fx_contact.linalg.linear_solver import LinearSolver
from fx_contact.linalg.solver_options import PRECONDITIONERS
from fx_contact.scenes import hertz
from studies.boxes import DOWN, LEFT, RIGHT, UP, Boxes

pytestmark = pytest.mark.ranks(1, 2, 3)

#: The first check and the price in iterations: the check comes later than the price, or earlier.
CHEAP, DEAR = (12, 4), (5, 20)


def plate(poisson=0.3):
    """One layer of flat cells between clamped ends, under pressure."""
    boxes = Boxes(1)
    boxes.add("plate", (0, 0, 0), (8, 4, 0.0625), (8, 4, 1))
    surfaces = {"ends": np.concatenate([boxes.facets(LEFT, 0.0), boxes.facets(RIGHT, 8.0)])}
    surfaces["top"] = boxes.facets(UP, 0.0625)
    held, loads = (Dirichlet("ends", 0.0, 0.0, 0.0),), (Traction("top", (0.0, 0.0, -1e-9)),)
    return Scene("plate", boxes.mesh(surfaces), {"plate": Material(1.0, poisson)}, held, (), loads)


def column(length):
    """A column of cubes, two by two, held below and pushed aside above."""
    boxes = Boxes(1)
    boxes.add("column", (0, 0, 0), (2, 2, length), (2, 2, length))
    surfaces = {"foot": boxes.facets(DOWN, 0.0), "top": boxes.facets(UP, length)}
    held, loads = (Dirichlet("foot", 0.0, 0.0, 0.0),), (Traction("top", (1e-9, 0.0, 0.0)),)
    return Scene("column", boxes.mesh(surfaces), {"column": Material(1.0, 0.3)}, held, (), loads)


def solved(scene, comm=WORLD, **solver):
    """The step on the root cells."""
    (step,) = adapt(scene, 0.9, degree=2, max_steps=1, solver=Solver(**solver), comm=comm)
    return step


def same(one, other):
    """Whether two steps have the same displacement, to what the solver leaves."""
    u, v = (step.solution.displacement for step in (one, other))
    size = one.elasticity.energy_norm(u)
    assert size > 0 and one.elasticity.energy_norm(u - v) < 1e-6 * size


@pytest.fixture
def analyses(monkeypatch):
    """What is analysed: unknowns and factors."""
    analyses, analysed = [], ladder.analysed

    def counted(matrix):
        analyses.append((matrix.getSize()[0], analysed(matrix)))
        return analyses[-1][1]

    monkeypatch.setattr(ladder, "analysed", counted)
    return analyses


@pytest.fixture
def at_price(monkeypatch, analyses):
    """A function that gives factors of the plate a price in iterations, with BoomerAMG below p-multigrid."""
    monkeypatch.setattr(ladder, "COARSE", 0.0)

    def at_price(first, price, poisson=0.3):
        monkeypatch.setattr(ladder, "FIRST_CHECK", first)
        monkeypatch.setattr(ladder, "FLOPS", 1e9)
        step = solved(plate(poisson))
        unknowns, factors = analyses[-1]
        assert unknowns == step.record.dofs
        row_lengths = step.elasticity.stiffness().row_lengths
        entries = 9 * WORLD.allreduce(sum(int(lengths.sum()) for lengths in row_lengths))
        an_iteration = factors.flops / (price - 0.5)
        monkeypatch.setattr(ladder, "FLOPS", an_iteration / entries)
        analyses.clear()

    return at_price


@pytest.mark.parametrize("poisson", [0.3, 0.49])
@pytest.mark.parametrize("first, price", [CHEAP, DEAR])
def test_factors_take_over_when_as_much_is_spent(at_price, analyses, first, price, poisson):
    """At the first check if they cost less than that, else when the iterations reach their price, analysed once.

    A few more follow, of rubber too: its factors are those of the whole stiffness, the volume strains with it.
    """
    at_price(first, price, poisson)
    step = solved(plate(poisson))
    assert step.record.preconditioner == "cholesky"
    assert [unknowns for unknowns, _ in analyses if unknowns == step.record.dofs] == [step.record.dofs]
    assert max(first, price) < step.record.krylov_iterations[-1] <= max(first, price) + 5
    same(solved(plate(poisson), preconditioner="cholesky"), step)


def test_factors_that_cost_more_are_not_taken(at_price):
    """PCG goes on from where it was, and converges before."""
    at_price(10, 1000)
    step = solved(plate(), max_krylov=2000)
    assert step.record.preconditioner == "p-multigrid" and step.record.krylov_iterations[-1] > 10
    same(solved(plate(), preconditioner="cholesky"), step)


def test_factors_that_fail_are_not_taken(at_price, monkeypatch):
    """MUMPS runs out of memory, and PCG goes on from where it was."""
    at_price(*CHEAP)
    monkeypatch.setitem(PRECONDITIONERS["cholesky"], "mat_mumps_icntl_23", 1)
    step = solved(plate(), max_krylov=2000)
    assert step.record.preconditioner == "p-multigrid"
    same(solved(plate(), max_krylov=2000, preconditioner="p-multigrid"), step)


@pytest.mark.parametrize("room, count", [(0, 0), (1, 1)])
def test_factors_without_memory_are_not_taken(at_price, analyses, monkeypatch, room, count):
    """Not analysed where the host has none, not computed where by the analysis they have none."""
    at_price(*CHEAP)
    asked = []

    def short(comm, size):
        asked.append(size)
        return None if len(asked) in range(2, 2 + room) else "no memory"  # the first is asked for the coarse level

    monkeypatch.setattr(ladder, "shortage", short)
    assert solved(plate(), max_krylov=2000).record.preconditioner == "p-multigrid"
    assert len(analyses) == count and len(asked) == 2 + room


@pytest.mark.parametrize("poisson", [0.3, 0.49])
def test_iterations_before_a_check_count(at_price, poisson):
    """After the most that are allowed, those before the checks among them, a stronger preconditioner takes over."""
    at_price(10, 30, poisson)
    step = solved(plate(poisson), max_krylov=25)
    assert step.record.preconditioner == "cholesky" and 25 < step.record.krylov_iterations[-1] <= 30
    same(solved(plate(poisson), preconditioner="cholesky"), step)


@pytest.mark.parametrize("chosen", [{"preconditioner": "p-multigrid"}, {"options": {"pc_type": "mg"}}])
def test_a_preconditioner_that_the_user_chose_stays(at_price, analyses, chosen):
    """Nothing takes over early."""
    at_price(*CHEAP)
    step = solved(plate(), **chosen, max_krylov=2000)
    assert step.record.preconditioner == "p-multigrid" and step.record.krylov_iterations[-1] > 60
    everywhere(all(unknowns < step.record.dofs for unknowns, _ in analyses), "factors were weighed")


def test_iterations_do_not_grow_with_the_length():
    """Of a column that bends: the coarse level is solved exactly; BoomerAMG, without rotations, takes more and more."""
    short, long = (solved(column(length)).record.krylov_iterations[-1] for length in (8, 32))
    amg = [
        solved(column(length), options={"mg_coarse_pc_hypre_boomeramg_max_iter": 1}).record.krylov_iterations[-1]
        for length in (8, 32)
    ]
    assert 5 < short and long <= short + 2, (short, long)
    assert amg[1] > amg[0] + 5 > short, (amg, short)


@pytest.mark.parametrize("share, taken", [(1.01, True), (0.5, False)])
def test_coarse_factors_by_their_price(monkeypatch, analyses, share, taken):
    """They are taken at a price of at most `COARSE` iterations; the solution is the same."""
    step = solved(column(8))
    unknowns, factors = analyses[0]
    assert unknowns < step.record.dofs / 4, "not of the coarse level"
    row_lengths = step.elasticity.stiffness().row_lengths
    entries = 9 * WORLD.allreduce(sum(int(lengths.sum()) for lengths in row_lengths))
    monkeypatch.setattr(ladder, "FLOPS", share * factors.flops / (ladder.COARSE * entries))
    choices, choose = [], LinearSolver._factorises_coarse
    monkeypatch.setattr(
        LinearSolver, "_factorises_coarse", lambda *args: choices.append(choose(*args)) or choices[-1]
    )
    again = solved(column(8))
    everywhere(choices == [taken], "another choice")
    same(step, again)


@pytest.mark.parametrize("reason", ["memory", "option"])
def test_coarse_level_stays_with_boomeramg(monkeypatch, analyses, reason):
    """Without memory for its factors, or where the user has an option for it."""
    options = {}
    if reason == "memory":
        monkeypatch.setattr(ladder, "shortage", lambda comm, size: "no memory")
    else:
        options = {"mg_coarse_pc_hypre_boomeramg_strong_threshold": 0.6}
    assert solved(column(4), options=options).record.preconditioner == "p-multigrid"
    assert not analyses


def test_prices_hardly_depend_on_the_number_of_ranks(analyses):
    """Nor do the choices: MUMPS orders the unknowns of all ranks as it does those of one."""
    alone = solved(column(32), MPI.COMM_SELF)
    (unknowns, serial), *_ = analyses
    analyses.clear()
    together = solved(column(32))
    (also, parallel), *_ = analyses
    everywhere(unknowns == also and 0.8 < parallel.flops / serial.flops < 1.25, "other prices")
    flops = WORLD.allgather(parallel.flops)
    assert min(flops) == max(flops), "ranks disagree"
    assert abs(alone.record.krylov_iterations[-1] - together.record.krylov_iterations[-1]) <= 1


def test_price_in_iterations():
    """Operations over `FLOPS` for each entry, rounded up."""
    assert ladder.Ladder(Solver(), 300, 9000, None, False).iterations(10.3 * ladder.FLOPS * 9000) == 11


def test_checks_end_a_solve():
    """At the check or at the most iterations of one solve, whichever comes first; solves since the set-up count."""
    one = ladder.Ladder(Solver(max_krylov=100), 300, 9000, None, False)
    one.check_at(30)
    assert [one.limit(0, 0), one.limit(5, 20), one.limit(0, 30), one.limit(3, 50)] == [30, 5, 1, 1]
    assert not one.due(29) and one.due(30)
    one.check_at(400)
    assert [one.limit(0, 0), one.limit(0, 320), one.limit(40, 320)] == [100, 80, 40]
    one.check_at(None)
    assert one.limit(40, 320) == 60 and not one.due(1000)


@pytest.mark.parametrize("again", [False, True])
def test_iterations_since_the_set_up(monkeypatch, again):
    """Those of the loose solve count in the tight one, unless there is another set-up between them."""
    since, begins, found = [0], [0], []
    set_up, solve, limit = LinearSolver.set_up, LinearSolver.solve, ladder.Ladder.limit

    def counted(self, *args):
        result = solve(self, *args)
        since[0] += self.iterations[-1]
        return result

    def seen(self, used, before):
        found.append((before, since[0]))
        return limit(self, used, before)

    def begun(self):
        since[0], begins[0] = 0, begins[0] + 1
        set_up(self)

    monkeypatch.setattr(LinearSolver, "set_up", begun)
    monkeypatch.setattr(LinearSolver, "is_slow", again)
    monkeypatch.setattr(LinearSolver, "solve", counted)
    monkeypatch.setattr(ladder.Ladder, "limit", seen)
    next(adapt(hertz(order=2, coarse=2), 0.5))
    assert len(found) > 1 and begins[0] == (len(found) if again else 1)
    everywhere((found[-1][0] > 0) != again and all(one == other for one, other in found), "other counts")
