"""Load paths with friction that were drawn: some are right, and the judge sees what is wrong."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from conftest import WORLD

from fx_contact.contact.constraint_rows import Role
from studies.stability import friction
from studies.stability.friction_scenes import EACH, paths
from studies.tables import TOP, read

PATHS = paths()

pytestmark = pytest.mark.skipif(WORLD.size > 1, reason="paths are solved on one rank")


def test_the_table():
    """The kept verdicts are of these paths, as many of each family."""
    _, kept = read(TOP / "studies/stability/friction.csv")
    assert [row["scene"] for row in kept] == list(PATHS)
    assert set(Counter(name.split("/")[0] for name in PATHS).values()) == {EACH}


@pytest.mark.parametrize("name", ["stack/1", "plate/1"])
def test_drawn_paths(name):
    """Node pairs, and an obstacle with a twin."""
    number = list(PATHS).index(name)
    one = friction.score(PATHS[name], number)
    assert one["verdict"] == "right" and len(one["all solves"]) == one["steps"], friction.line(one)
    twin = friction.twin_of(PATHS[name], number)
    compared = [check for check in one["checks"] if twin and check[0].startswith(twin.__name__)]
    assert len(compared) == (one["steps"] if twin else 0)


def tangents(solution, factor):
    """Forces of all rows, those of tangents times a factor."""
    return np.where(solution.rows.role == Role.TANGENT, factor, 1.0) * solution.row_force


SPOILT = {
    "more": (lambda c: replace(c, row_force=tangents(c, 1.001)), "no more than the bound"),
    "less": (lambda c: replace(c, row_force=tangents(c, 0.999)), "the bound where it slips"),
    "reversed": (lambda c: replace(c, row_force=tangents(c, -1.0)), "stick, or slip along the force"),
    "gained": (lambda c: replace(c, row_force=tangents(c, -1.0)), "no work is gained"),
    "status": (lambda c: replace(c, slipping=~c.slipping & c.active), "nodes of the record"),
    "open": (lambda c: replace(c, active=np.zeros_like(c.active)), "open nodes carry nothing"),
    "balance": (lambda c: replace(c, row_force=tangents(c, 0.0)), "balance of each body"),
    "slips": (lambda c: replace(c, slipping=np.zeros_like(c.slipping)), "no slip where it sticks"),
}


@pytest.fixture(scope="module")
def last():
    """The last step of a path that slips, its scene and the one before."""
    (before, _), (scene, step), *_ = friction.solve(PATHS["cubes/1"])
    return step, scene, before


@pytest.mark.parametrize("spoil, check", SPOILT.values(), ids=SPOILT)
def test_the_judge_sees_a_spoilt_solution(last, spoil, check):
    """Each check fails where what it is for is wrong, and holds where nothing is."""
    step, scene, before = last
    assert step.record.slipping_pairs > 0
    assert all(c.holds for c in friction.Friction(step, scene, before).checks())
    spoilt = replace(step, solution=spoil(step.solution))
    assert check in [c.name for c in friction.Friction(spoilt, scene, before).checks() if not c.holds]
