"""The contact radius that all ranks have together, from node pairs made up; other ranks may have none."""

from types import SimpleNamespace

import numpy as np
import pytest
from conftest import WORLD

from fx_contact.scenes import patch
from fx_contact.verdict.contact_figures import figures_of_contact

pytestmark = pytest.mark.ranks(1, 2, 3)


@pytest.mark.parametrize("power, is_hertz", [(2, True), (1.5, True), (1, False), (3, False), (4, False), (0, False)])
@pytest.mark.parametrize("apart", [0.0, 1e3])
def test_radius(power, is_hertz, apart):
    """Forces of Hertz's pressure have its radius where the gap grows quadratically, or nearly so, however far apart."""
    found = of_quarter(np.linspace(0.025, 0.475, 10), lambda r: apart + 0.3 * r**power)
    assert found.pair_areas == pytest.approx([np.pi * 0.5**2], rel=1e-6)
    assert found.active_pairs == 80 and found.force == pytest.approx(4 * 2 / 3 * np.pi / 4 * 0.25, rel=0.01)
    assert found.contact_radius == (pytest.approx(0.5, rel=0.01) if is_hertz else None)
    hollow = of_quarter(np.linspace(0.025, 0.475, 10), lambda r: apart - 0.3 * r**power)
    assert hollow.contact_radius is None


@pytest.mark.parametrize("r, radius", [([], 0.0), ([0.0], None)])
def test_no_radius(r, radius):
    """Without contact it is 0; a single closed pair has a force and no radius."""
    found = of_quarter(np.array(r), lambda r: r**2)
    assert found.contact_radius == radius and (found.force > 0) == bool(r)


@pytest.mark.parametrize("exponent, is_hertz", [(0.5, True), (0.57, False), (1.0, False)])
def test_no_radius_on_a_layer(exponent, is_hertz):
    """On layers of 1.3 and 0.1 radii: it would be 1.4 and 9 % too small."""
    found = of_quarter(np.linspace(0.025, 0.475, 10), lambda r: r**2, exponent)
    assert (found.contact_radius is not None) == is_hertz


def of_quarter(r, gap, exponent=0.5):
    """Figures of a quarter with pressure (1 - r^2 / a^2)^exponent, Hertz's, a = 0.5; all on the first rank."""
    r = r if WORLD.rank == 0 else r[:0]
    angle = np.tile(np.linspace(0, np.pi / 2, 8 if len(r) > 1 else len(r)), len(r))
    r = np.repeat(r, 8 if len(r) > 1 else len(r))
    ring = 0.05 * np.maximum(r, 0.025) * np.pi / 2 / 8
    rows = SimpleNamespace(
        contact=np.zeros(len(r), dtype=int),
        normal=np.tile([0.0, 0.0, 1.0], (len(r), 1)),
        position=np.stack([r * np.cos(angle), r * np.sin(angle), np.ones(len(r))], axis=1),
        area=ring,
        gap=gap(r),
        force_components=lambda force: force,
    )
    pressure = (1 - (r / 0.5) ** 2) ** exponent
    solution = SimpleNamespace(
        force=pressure * ring, active=np.ones(len(r), bool), pressure=pressure, penetration=pressure
    )
    return figures_of_contact(patch(cells=(1, 1, 2)), rows, solution, WORLD)
