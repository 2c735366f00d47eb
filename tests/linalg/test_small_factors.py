"""Cholesky's factors take over early where they are small, as those of thin bodies are, and nowhere else."""

import numpy as np
import pytest
from conftest import everywhere

from fx_contact import Dirichlet, Material, Scene, Solver, Traction, adapt
from fx_contact.linalg import conjugate_gradients
from fx_contact.scenes.boxes import LEFT, RIGHT, UP, Boxes


def plate(poisson=0.3):
    """One layer of flat cells between clamped ends, under pressure."""
    boxes = Boxes(1)
    boxes.add("plate", (0, 0, 0), (8, 4, 0.0625), (8, 4, 1))
    surfaces = {"ends": np.concatenate([boxes.facets(LEFT, 0.0), boxes.facets(RIGHT, 8.0)])}
    surfaces["top"] = boxes.facets(UP, 0.0625)
    loads = (Traction("top", (0.0, 0.0, -1e-9)),)
    return Scene(
        "plate", boxes.mesh(surfaces), {"plate": Material(1.0, poisson)}, (Dirichlet("ends", 0.0, 0.0, 0.0),), (), loads
    )


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
    """Looks after 10 and 20 iterations that MUMPS refuses: the bytes asked of it."""
    tried, factorise = [], conjugate_gradients.ConjugateGradients._factorise

    def counted(self, most):
        tried.append(most)
        factorise(self, most)

    monkeypatch.setattr(conjugate_gradients.ConjugateGradients, "_factorise", counted)
    monkeypatch.setattr(conjugate_gradients.ConjugateGradients, "_LOOKS_OF_FLAT", ((10, 1.0), (20, 2.0)))
    return tried


def test_factors_that_are_large_do_not(tried):
    """MUMPS refuses them, and PCG goes on from where it was: once for each look."""
    step = solved(max_krylov=2000)
    everywhere(tried == [1.0, 2.0], "other looks")
    assert step.record.preconditioner == "p-multigrid"
    same(solved(preconditioner="cholesky"), step)


@pytest.mark.parametrize("limit, taken", [(600.0, False), (950.0, True)])
def test_factors_are_taken_by_their_size(monkeypatch, limit, taken):
    """766 bytes an unknown for this plate, on any number of ranks."""
    monkeypatch.setattr(conjugate_gradients.ConjugateGradients, "_LOOKS_OF_FLAT", ((10, limit),))
    step = solved(max_krylov=2000)
    everywhere(step.record.preconditioner == ("cholesky" if taken else "p-multigrid"), "factors by their size")


def test_factors_that_fail_are_not_taken(monkeypatch):
    """MUMPS runs out of memory, and PCG goes on from where it was."""
    monkeypatch.setitem(conjugate_gradients.PRECONDITIONERS["cholesky"], "mat_mumps_icntl_23", 1)
    everywhere(solved(max_krylov=2000).record.preconditioner == "p-multigrid", "no factors")


def test_looks_count_as_iterations(tried):
    """After the most that are allowed, those before the looks among them, a stronger preconditioner takes over."""
    step = solved(max_krylov=40)
    everywhere(tried == [1.0, 2.0], "other looks")
    assert step.record.preconditioner == "cholesky" and 40 < step.record.krylov_iterations[-1] < 45


def test_a_preconditioner_that_the_user_chose_stays():
    """Nothing takes over early."""
    step = solved(preconditioner="p-multigrid", max_krylov=2000)
    assert step.record.preconditioner == "p-multigrid" and step.record.krylov_iterations[-1] > 60
