"""Cholesky factors: below p-multigrid where it is small, in its place where a solve takes many iterations."""

import numpy as np
import pytest
from conftest import WORLD

from fx_contact import Dirichlet, Material, Scene, Solver, Traction, adapt
from fx_contact.linalg import ladder
from fx_contact.linalg.preconditioner import Preconditioner
from fx_contact.linalg.solver_options import PRECONDITIONERS
from fx_contact.scenes import hertz
from studies.boxes import DOWN, LEFT, RIGHT, UP, Boxes

pytestmark = pytest.mark.ranks(1, 2, 3)

#: Iterations after which factors take over, in tests of a plate that takes more than 60.
FEW = 12


def plate(poisson=0.3):
    """One layer of flat cells between clamped ends, under pressure."""
    boxes = Boxes(1)
    boxes.add("plate", (0, 0, 0), (8, 4, 0.0625), (8, 4, 1))
    surfaces = {"ends": np.concatenate([boxes.facets(LEFT, 0.0), boxes.facets(RIGHT, 8.0)])}
    surfaces["top"] = boxes.facets(UP, 0.0625)
    held, loads = (Dirichlet("ends", 0.0, 0.0, 0.0),), (Traction("top", (0.0, 0.0, -1e-9)),)
    return Scene("plate", boxes.mesh(surfaces), {"plate": Material(1.0, poisson)}, held, (), loads)


def column(length, side=2):
    """A column of cubes, held below and pushed aside above."""
    boxes = Boxes(1)
    boxes.add("column", (0, 0, 0), (side, side, length), (side, side, length))
    surfaces = {"foot": boxes.facets(DOWN, 0.0), "top": boxes.facets(UP, length)}
    held, loads = (Dirichlet("foot", 0.0, 0.0, 0.0),), (Traction("top", (1e-9, 0.0, 0.0)),)
    return Scene("column", boxes.mesh(surfaces), {"column": Material(1.0, 0.3)}, held, (), loads)


def solved(scene, **solver):
    """The step on the root cells."""
    (step,) = adapt(scene, 0.9, degree=2, max_steps=1, solver=Solver(**solver))
    return step


def same(one, other):
    """Whether two steps have the same displacement, to what the solver leaves."""
    u, v = (step.solution.displacement for step in (one, other))
    size = one.elasticity.energy_norm(u)
    assert size > 0 and one.elasticity.energy_norm(u - v) < 1e-6 * size


@pytest.fixture
def impatient(monkeypatch):
    """Factors take over after `FEW` iterations; below p-multigrid stands BoomerAMG."""
    monkeypatch.setattr(ladder, "FEWEST", FEW)
    monkeypatch.setattr(ladder, "PER_SIDE", 0.0)
    monkeypatch.setattr(ladder, "COARSE", 0)


@pytest.mark.parametrize("poisson", [0.3, 0.49])
def test_factors_take_over_after_many_iterations(impatient, poisson):
    """A few more follow, of rubber too: its factors are those of the whole stiffness, the volume strains with it."""
    step = solved(plate(poisson))
    assert step.record.preconditioner == "cholesky"
    assert FEW < step.record.krylov_iterations[-1] <= FEW + 5
    same(solved(plate(poisson), preconditioner="cholesky"), step)


def test_factors_that_fail_are_not_taken(impatient, monkeypatch):
    """MUMPS runs out of memory, and PCG goes on from where it was."""
    monkeypatch.setitem(PRECONDITIONERS["cholesky"], "mat_mumps_icntl_23", 1)
    step = solved(plate(), max_krylov=2000)
    assert step.record.preconditioner == "p-multigrid" and step.record.krylov_iterations[-1] > 60
    same(solved(plate(), max_krylov=2000, preconditioner="p-multigrid"), step)


def test_factors_without_memory_are_not_taken(impatient, monkeypatch):
    """They are not made where the hosts have no memory for them."""
    asked = []
    monkeypatch.setattr(ladder, "shortage", lambda comm, size: asked.append(size) or "no memory")
    step = solved(plate(), max_krylov=2000)
    assert step.record.preconditioner == "p-multigrid"
    assert asked == [ladder.predicted_bytes(step.record.dofs) / WORLD.size]


@pytest.mark.parametrize("poisson", [0.3, 0.49])
def test_iterations_before_factors_count(impatient, monkeypatch, poisson):
    """After the most that are allowed, those before among them, a stronger preconditioner takes over."""
    answers = iter(["no memory"])  # for factors that take over early, but for those after a failure
    monkeypatch.setattr(ladder, "shortage", lambda comm, size: next(answers, None))
    step = solved(plate(poisson), max_krylov=25)
    assert step.record.preconditioner == "cholesky" and 25 < step.record.krylov_iterations[-1] <= 30
    same(solved(plate(poisson), preconditioner="cholesky"), step)


@pytest.mark.parametrize("chosen", [{"preconditioner": "p-multigrid"}, {"options": {"pc_type": "mg"}}])
def test_a_preconditioner_that_the_user_chose_stays(impatient, chosen):
    """Nothing takes over early."""
    step = solved(plate(), **chosen, max_krylov=2000)
    assert step.record.preconditioner == "p-multigrid" and step.record.krylov_iterations[-1] > 60


def test_rubber_in_contact_stays_with_p_multigrid():
    """Its solves take few iterations, however many there are: factors of another active set would take more."""
    rubber = hertz(material=Material(1.0, 0.4999), order=2, coarse=2)
    records = [step.record for step in adapt(rubber, 0.2, max_steps=3)]
    assert sum(records[-1].krylov_iterations) > 30 > 25 >= max(max(record.krylov_iterations) for record in records)
    assert {record.preconditioner for record in records} == {"p-multigrid"}


def test_iterations_do_not_grow_with_the_length():
    """Of a column that bends: the coarse level is solved exactly; BoomerAMG, without rotations, takes more and more."""
    short, long = (solved(column(length)).record.krylov_iterations[-1] for length in (8, 32))
    amg = [
        solved(column(length), options={"mg_coarse_pc_hypre_boomeramg_max_iter": 1}).record.krylov_iterations[-1]
        for length in (8, 32)
    ]
    assert 5 < short and long <= short + 2, (short, long)
    assert amg[1] > amg[0] + 5 > short, (amg, short)


def watched(monkeypatch, read):
    """A list of what is read of each PC of PETSc that is set up."""
    found, set_up = [], Preconditioner.set_up

    def seen(self, *args):
        set_up(self, *args)
        found.append(read(self.pc))

    monkeypatch.setattr(Preconditioner, "set_up", seen)
    return found


@pytest.mark.parametrize("reason", ["size", "memory", "option"])
def test_coarse_level_stays_with_boomeramg(monkeypatch, reason):
    """Where it is larger than `COARSE`, without memory for its factors, or where the user has an option for it."""
    below = watched(monkeypatch, lambda pc: pc.getMGCoarseSolve().getPC().getType())
    sizes = watched(monkeypatch, lambda pc: pc.getMGCoarseSolve().getOperators()[0].getSize()[0])
    step = solved(column(4))
    monkeypatch.setattr(ladder, "COARSE", sizes[-1])
    solved(column(4))
    assert sizes[-1] < step.record.dofs / 4 and set(below) == {"cholesky"}
    options = {}
    if reason == "size":
        monkeypatch.setattr(ladder, "COARSE", sizes[-1] - 1)
    elif reason == "memory":
        monkeypatch.setattr(ladder, "shortage", lambda comm, size: "no memory")
    else:
        options = {"mg_coarse_pc_hypre_boomeramg_strong_threshold": 0.6}
    again = solved(column(4), options=options)
    assert below[-1] == "hypre"
    same(step, again)


def test_predicted_memory_of_factors(monkeypatch):
    """That of a cube is enough for the entries of MUMPS' factors, and at most twice as much."""
    entries = watched(monkeypatch, lambda pc: pc.getFactorMatrix().getMumpsInfog(29))
    step = solved(column(6, 6), preconditioner="cholesky")
    assert 0.5 < 8 * entries[-1] / ladder.predicted_bytes(step.record.dofs) < 1


@pytest.mark.parametrize("unknowns, most", [(300, 30), (8_000, 30), (64_000, 48), (1_000_000, 120)])
def test_patience(unknowns, most):
    """Factors wait for more iterations in larger systems, and for a failure if no more are allowed."""
    assert ladder.patience(Solver(), unknowns, {}) == most
    assert ladder.patience(Solver(max_krylov=most), unknowns, {}) is None
