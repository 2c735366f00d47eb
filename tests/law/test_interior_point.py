"""The interior-point method finds the same active sets as their updates, and those of bodies that bend."""

from dataclasses import replace
from functools import partial

import pytest
from conftest import everywhere
from model_problems import corner_scene

from fx_contact import Enforcement, Material, adapt
from fx_contact.law import contact_solver
from fx_contact.law.interior_point import find_closed_rows
from fx_contact.scenes import hertz, shrink_fit, spheres
from studies.cost.leaf_springs import leaf_springs

pytestmark = pytest.mark.ranks(1, 2, 3)


RUBBER = Material(1.0, 0.499)
CASES = {
    "hertz": (partial(hertz, coarse=2), {}),
    "degree 1": (partial(hertz, coarse=2), {"degree": 1}),
    "rows of other ranks": (partial(hertz, coarse=2), {"partition_kind": "sfc"}),
    "soft penalty": (partial(hertz, coarse=2), {"enforcement": Enforcement("penalty", factor=10.0)}),
    "stiff penalty": (partial(hertz, coarse=2), {"enforcement": Enforcement("penalty", factor=1e10)}),
    "nodes in two rows": (corner_scene, {}),
    "rubber": (partial(spheres, coarse=2, lower=RUBBER, upper=RUBBER), {}),
    "interference": (shrink_fit, {}),
}


@pytest.mark.parametrize("case", CASES)
def test_same_solution_as_updates(case, monkeypatch):
    """The method finds the rows, and the forces, that updates of the set find."""
    make, options = CASES[case]
    scene, solves, updates = make(), [], contact_solver.solve_law

    def find(system, status, u, solver):
        found, closed, count = find_closed_rows(system, status, u)
        status.restart(closed, found, count)
        result = updates(system, status, found, solver)
        solves.append((count, system.energy_norm(found - result[0]) / system.energy_norm(result[0])))
        return result

    (expected,) = adapt(scene, 0.9, max_steps=1, **options)
    monkeypatch.setattr(contact_solver, "solve_law", find)
    (step,) = adapt(scene, 0.9, max_steps=1, **options)
    ((count, off),) = solves
    assert 5 < count < 35 and off < 1e-6  # the root of its last s . f over the energy
    assert step.record.pair_forces == pytest.approx(expected.record.pair_forces, rel=1e-7)
    everywhere((step.solution.active == expected.solution.active).all(), "other rows are closed")
    assert step.record.contact_iterations <= count + 4, "too many updates of the set that was found"


@pytest.mark.parametrize("loaded", [True, False], ids=["load", "displacement"])
def test_leaf_springs(loaded):
    """Updates of the set open a line of nodes each: 39 with 20 cells, 77 with 40."""
    scene, force = leaf_springs(40, loaded=loaded)
    (step,) = adapt(scene, 0.9, max_steps=1)
    assert step.record.pair_forces[0] == pytest.approx(force, rel=1e-3)
    assert len(step.record.krylov_iterations) < 60


def test_a_preconditioner_of_few_rows():
    """Five slender plates: 20 rows are closed, then more than 300; PCG fails with the factors of the 20."""
    scene, force = leaf_springs(10, plates=5, slenderness=200, loaded=False)
    (step,) = adapt(scene, 0.9, max_steps=1)
    assert step.record.active_pairs > 200
    assert step.record.pair_forces[0] == pytest.approx(force, rel=3e-3)


def test_contact_that_opens():
    """Springs pulled apart: all rows open, and all forces tend to 0."""
    scene, _ = leaf_springs(20)
    (load,) = scene.tractions
    pulled = replace(scene, tractions=(replace(load, value=tuple(-x for x in load.value)),))
    (step,) = adapt(pulled, 0.9, max_steps=1)
    assert not any(step.record.pair_forces)
    assert len(step.record.krylov_iterations) < 65
