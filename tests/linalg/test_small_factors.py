"""Cholesky factors take over early where they are small, as those of thin bodies are, and nowhere else."""

import numpy as np
import pytest
from conftest import everywhere

from fx_contact import Dirichlet, Material, Scene, Solver, Traction, adapt
from fx_contact.linalg import ladder
from fx_contact.linalg.linear_solver import LinearSolver
from fx_contact.linalg.solver_options import PRECONDITIONERS
from studies.boxes import LEFT, RIGHT, UP, Boxes


def plate(poisson=0.3):
    """One layer of flat cells between clamped ends, under pressure."""
    boxes = Boxes(1)
    boxes.add("plate", (0, 0, 0), (8, 4, 0.0625), (8, 4, 1))
    surfaces = {"ends": np.concatenate([boxes.facets(LEFT, 0.0), boxes.facets(RIGHT, 8.0)])}
    surfaces["top"] = boxes.facets(UP, 0.0625)
    held, loads = (Dirichlet("ends", 0.0, 0.0, 0.0),), (Traction("top", (0.0, 0.0, -1e-9)),)
    return Scene("plate", boxes.mesh(surfaces), {"plate": Material(1.0, poisson)}, held, (), loads)


def solved(poisson=0.3, **solver):
    """The step on the root cells."""
    (step,) = adapt(plate(poisson), 0.9, degree=2, max_steps=1, solver=Solver(**solver))
    return step


def same(one, other):
    """Whether two steps have the same displacement, to what the solver leaves."""
    u, v = (step.solution.displacement for step in (one, other))
    size = one.elasticity.energy_norm(u)
    assert size > 0 and one.elasticity.energy_norm(u - v) < 1e-6 * size


@pytest.mark.parametrize("poisson, least, most", [(0.3, 30, 40), (0.49, 50, 60)])
def test_factors_of_a_plate_take_over(poisson, least, most):
    """After 30 or 50 iterations that have not converged; the solution is that of factors alone.

    A few more follow, of rubber too: its factors are those of the whole stiffness, the volume strains with it.
    """
    step, direct = solved(poisson), solved(poisson, preconditioner="cholesky")
    assert step.record.preconditioner == "cholesky"
    assert least < step.record.krylov_iterations[-1] < most
    same(direct, step)


@pytest.fixture
def tried(monkeypatch):
    """Checks after 10 and 30 iterations that no factors pass: the bytes that they allow."""
    tried, factorise = [], LinearSolver._factorise

    def counted(self, most):
        tried.append(most)
        return factorise(self, most)

    monkeypatch.setattr(LinearSolver, "_factorise", counted)
    monkeypatch.setitem(ladder.FACTORISATION_CHECKS, "flat cells", ((10, 1.0), (30, 2.0)))
    return tried


def test_factors_that_are_large_do_not(tried):
    """They are refused, and PCG goes on from where it was: once for each check."""
    step = solved(max_krylov=2000)
    everywhere(tried == [step.record.dofs, 2 * step.record.dofs], "other checks")
    assert step.record.preconditioner == "p-multigrid"
    same(solved(preconditioner="cholesky"), step)


@pytest.mark.parametrize("limits, taken_after", [((950.0, 950.0), 10), ((600.0, 950.0), 30), ((600.0, 600.0), None)])
def test_factors_are_taken_by_their_size(monkeypatch, limits, taken_after):
    """766 bytes an unknown for this plate, on any number of ranks; checks after 10 and 30 iterations."""
    monkeypatch.setitem(ladder.FACTORISATION_CHECKS, "flat cells", tuple(zip((10, 30), limits)))
    record = solved(max_krylov=2000).record
    assert record.preconditioner == ("cholesky" if taken_after else "p-multigrid")
    assert taken_after is None or taken_after < record.krylov_iterations[-1] < taken_after + 5


def test_factors_that_fail_are_not_taken(monkeypatch):
    """MUMPS runs out of memory, and PCG goes on from where it was."""
    monkeypatch.setitem(PRECONDITIONERS["cholesky"], "mat_mumps_icntl_23", 1)
    step = solved(max_krylov=2000)
    assert step.record.preconditioner == "p-multigrid"
    same(solved(max_krylov=2000, preconditioner="p-multigrid"), step)


@pytest.mark.parametrize("asked_before", [0, 1])
def test_factors_without_memory_are_not_taken(monkeypatch, asked_before):
    """Not analysed where the largest taken has no room, not computed where by the analysis they have none."""
    asked, analyses, analysed = [], [], ladder.analysed

    def short(comm, size):
        asked.append(size)
        return "no memory" if len(asked) > asked_before else None

    monkeypatch.setattr(ladder, "shortage", short)
    monkeypatch.setattr(ladder, "analysed", lambda matrix: analyses.append(1) or analysed(matrix))
    assert solved(max_krylov=2000).record.preconditioner == "p-multigrid"
    assert len(analyses) == asked_before


def test_iterations_before_a_check_count(tried):
    """After the most that are allowed, those before the checks among them, a stronger preconditioner takes over."""
    step = solved(max_krylov=40)
    everywhere(tried == [step.record.dofs, 2 * step.record.dofs], "other checks")
    assert step.record.preconditioner == "cholesky" and 40 < step.record.krylov_iterations[-1] < 45


@pytest.mark.parametrize("chosen", [{"preconditioner": "p-multigrid"}, {"options": {"pc_type": "mg"}}])
def test_a_preconditioner_that_the_user_chose_stays(chosen):
    """Nothing takes over early."""
    step = solved(**chosen, max_krylov=2000)
    assert step.record.preconditioner == "p-multigrid" and step.record.krylov_iterations[-1] > 60
