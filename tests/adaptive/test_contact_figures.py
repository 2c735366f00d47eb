"""Figures of contact that all ranks have together, from node pairs made up; one rank may have none."""

from types import SimpleNamespace

import numpy as np
import pytest
from conftest import WORLD
from model_problems import side_by_side

from fx_contact.adaptive.contact_figures import figures_of_contact
from fx_contact.contact.constraint_rows import ConstraintRows
from fx_contact.scenes import patch

pytestmark = pytest.mark.ranks(1, 2, 3)


@pytest.mark.parametrize("idle", [False, True])
def test_figures_of_all_ranks(idle):
    """Forces and counts add up over ranks and by pair; pressure and penetration are the largest of all."""
    most = max(WORLD.size - idle, 1)
    each = 0 if WORLD.rank == most else 2
    number = np.arange(2 * WORLD.rank, 2 * WORLD.rank + each)
    rows = SimpleNamespace(
        contact=number % 2,
        normal=np.tile([0.0, 0.6, 0.8], (each, 1)),
        position=np.stack([number, 0 * number, 0 * number + 5.0], axis=1).astype(float),
        area=np.full(each, 0.5),
        kinds=[SimpleNamespace(contact=contact, index=index) for index, contact in enumerate(side_by_side().contact)],
    )
    rows.force_components = lambda force: ConstraintRows.force_components(rows, force)
    solution = SimpleNamespace(
        force=1.0 + number, active=number > 0, pressure=2.0 + number, penetration=0.01 * (1.0 + number)
    )
    found = figures_of_contact(side_by_side(), rows, solution, WORLD)
    n = 2 * most
    force = 1.0 + np.arange(n)
    assert found.active_pairs == n - 1
    assert np.allclose(found.pair_forces, 0.8 * np.array([force[::2].sum(), force[1::2].sum()]))
    assert np.isclose(found.force, 0.8 * force.sum()) and np.allclose(found.pair_alignments, 1.0)
    assert np.allclose(found.contact_centre, [force @ np.arange(n) / force.sum(), 0.0, 5.0])
    assert np.isclose(found.max_pressure, 1.0 + n) and np.isclose(found.max_penetration, 0.01 * n)
    assert found.contact_radius is None, "two contact pairs"


@pytest.mark.parametrize("points, radius", [(0, 0.0), (1, None), (8, 0.5 * np.sqrt(2.5))])
def test_radius(points, radius):
    """Of equal forces on a circle it is that of Hertz's pressure; a single closed pair has a force and no radius."""
    angle = np.linspace(0, np.pi / 2, points if WORLD.rank == 0 else 0)  # of a quarter model
    n, ring = len(angle), 0.5 if points > 1 else 0.0
    rows = SimpleNamespace(
        contact=np.zeros(n, dtype=int),
        normal=np.tile([0.0, 0.0, 1.0], (n, 1)),
        position=np.stack([ring * np.cos(angle), ring * np.sin(angle), np.ones(n)], axis=1),
        area=np.full(n, 0.5),
        force_components=lambda force: force,
    )
    solution = SimpleNamespace(force=np.full(n, 3.0), active=np.ones(n, bool), pressure=angle, penetration=angle)
    found = figures_of_contact(patch(cells=(1, 1, 2)), rows, solution, WORLD)
    assert found.active_pairs == points and found.force == 4 * 3.0 * points
    assert found.contact_radius == (radius if points < 2 else pytest.approx(radius))
