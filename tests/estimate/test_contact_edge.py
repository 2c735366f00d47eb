"""Errors of goals by the edge of a contact that is inside a facet."""

from functools import cache

import numpy as np
import pytest

from fx_contact import (
    ContactForce,
    ContactPair,
    Dirichlet,
    Material,
    MaxPressure,
    Scene,
    SymmetryPlane,
    adapt,
    block,
    root_mesh_from_shapes,
    solve,
)
from fx_contact.estimate.contact_edge import ContactEdge

PARALLEL = pytest.mark.ranks(1, 2, 3)
PAIR = "lower top on upper bottom"


@cache
def fine_force():
    """Force of the slice on a much finer mesh."""
    *_, step = adapt(roller(), 0.1, goals=ContactForce(PAIR, 0.002))
    assert step.record.reached and step.record.active_pairs > 100
    return step.record.force


def roller(facets=5):
    """Half of a slice of a roller in a groove, pressed down: the half width of the contact is half a facet."""
    lower = block((0, 0, -15), (10, 0.5, 0), (5, 1, 5))
    upper = block((0, 0, 0), (10, 0.5, 10), (facets, 1, 5))
    bodies = {
        "lower": lower.placed(lambda x: (x[0], x[1], x[2] + (x[2] + 15) / 15 * x[0] ** 2 / 30)),
        "upper": upper.placed(lambda x: (x[0], x[1], x[2] + (10 - x[2]) / 10 * x[0] ** 2 / 20)),
    }
    planes = [SymmetryPlane(f"{body} {side}") for body in bodies for side in ("front", "back", "left")]
    return Scene(
        "roller",
        root_mesh_from_shapes(bodies),
        {"lower": Material(70e3, 0.33), "upper": Material(210e3, 0.3)},
        (Dirichlet("lower bottom", z=0.0), Dirichlet("upper top", z=-0.0224), *planes),
        ContactPair("lower top", "upper bottom"),
        symmetry=2,
    )


@PARALLEL
@pytest.mark.parametrize("facets", [5, 8], ids=["alike", "apart"])
def test_estimate_sees_the_edge(facets):
    """A closed strip of one facet: the force is 3 % wrong, and the estimate says so before the goal is reached."""
    for step in adapt(roller(facets), 0.3, goals=ContactForce(PAIR, 0.005)):
        (goal,) = step.record.goals
        if goal.error is not None:
            assert abs(goal.value - fine_force()) < 1.5 * goal.error
    assert goal.reached and step.record.step >= 3
    assert goal.value == pytest.approx(fine_force(), rel=0.005)


@PARALLEL
def test_integral_at_the_edge():
    """One part of a facet along a straight edge: pi / 20 of its area, the mean pressure and the mean jump."""
    step = solve(roller(), 0.3, max_steps=2)
    rows, active = step.rows, step.solution.active
    line = np.unique(np.concatenate(step.forest.comm.allgather(rows.position[active][:, 0])).round(9))
    beyond = np.unique(np.concatenate(step.forest.comm.allgather(rows.position[~active][:, 0])).round(9))
    edge, first = line.max(), beyond[beyond > line.max()].min()
    assert len(line) == 2, "two lines of nodes are closed"

    at_edge = np.isclose(rows.position[:, 0], edge) & active
    total = step.forest.comm.allreduce
    pressure = total(float(step.solution.pressure[at_edge].sum())) / total(int(at_edge.sum()))
    found = total(float(ContactEdge(step).on_cells(~active * 1.0).sum()))
    assert found == pytest.approx(np.pi / 20 * (first - edge) * 0.5 * pressure, rel=0.02)


@PARALLEL
def test_refinement_at_the_edge():
    """A largest pressure to 2 % needs the edge, too: Hertz's line contact of the same force."""
    step = solve(roller(), 0.3, goals=MaxPressure(PAIR, 0.02))
    modulus = 1 / (1 / Material(70e3, 0.33).plane_strain_modulus + 1 / Material(210e3, 0.3).plane_strain_modulus)
    radius, force = 1 / (1 / 10 - 1 / 15), fine_force() / 0.5
    assert step.record.max_pressure == pytest.approx(np.sqrt(force * modulus / (np.pi * radius)), rel=0.03)
