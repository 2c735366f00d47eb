"""Several loads at once: they add up, and each has its own resultant."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import DISTRIBUTIONS, discrete, grown, pressed, roots, two_boxes

from fx_contact import BodyForce, Pressure, Traction
from fx_contact.fem.external_forces import body_force, finer_totals, load_and_totals

pytestmark = pytest.mark.ranks(1, 2, 3)

#: On the boxes [0, 2]^3 and [0, 2]^2 x [-1, 0]: each load, its body, its force and where that acts.
LOADS = (
    (Traction("upper x high", (1.0, 2.0, -3.0)), 1, (4.0, 8.0, -12.0), (2.0, 1.0, 1.0)),
    (Pressure("lower y high", 5.0), 0, (0.0, -10.0, 0.0), (1.0, 2.0, -0.5)),
    (Pressure("upper x high", 0.5), 1, (-2.0, 0.0, 0.0), (2.0, 1.0, 1.0)),
    (BodyForce("upper", (0.1, 0.0, -0.2)), 1, (0.8, 0.0, -1.6), (1.0, 1.0, 1.0)),
    (BodyForce("lower", lambda x: np.full_like(x, 0.3)), 0, (1.2, 1.2, 1.2), (1.0, 1.0, -0.5)),
    (BodyForce("upper", (0.0, 0.4, 0.0)), 1, (0.0, 3.2, 0.0), (1.0, 1.0, 1.0)),
)


def under(*loads):
    """The two boxes under some loads."""
    surface, volume = ([one for one in loads if isinstance(one, BodyForce) == of] for of in (False, True))
    return replace(pressed(two_boxes()), tractions=tuple(surface), body_forces=tuple(volume))


@pytest.mark.parametrize("distribution", list(DISTRIBUTIONS))
@pytest.mark.parametrize("degree", [1, 2])
def test_loads_add_up(degree, distribution):
    """The load is the sum of what each makes alone; force and moment of each are those by hand, on its body alone."""
    scene = under(*(load for load, *_ in LOADS))
    forest = DISTRIBUTIONS[distribution](grown(roots(scene), 1))
    elasticity = discrete(scene, forest, degree=degree)
    forces, totals = load_and_totals(scene, forest, elasticity)
    alone = [load_and_totals(under(load), forest, elasticity)[0] for load, *_ in LOADS]
    everywhere(np.allclose(forces, sum(alone), rtol=0, atol=1e-13), "not the sum")
    exact = np.zeros((len(LOADS), 2, 6))
    for row, (_, body, force, at) in zip(exact, LOADS):
        row[body] = *force, *np.cross(at, force)
    assert np.allclose(WORLD.allreduce(totals), exact, rtol=0, atol=1e-12)
    density = body_force(scene, elasticity).x.array.reshape(-1, 3)
    expected = np.array([[0.1, 0.4, -0.2], [0.3, 0.3, 0.3]])
    off = np.abs(density[:, None] - expected).max(axis=2)
    everywhere((off.min(axis=1) < 1e-15).all(), "not the sum of the body forces of a body")


def test_finer_sums():
    """Net force and magnitude of loads that are functions and cancel; constant loads are left out."""
    swing = Traction("upper y high", lambda x: np.stack([0 * x[0], 0 * x[0], 3 * (x[0] - 1)]))
    ramp = BodyForce("lower", lambda x: np.stack([x[1], 0 * x[0], 0 * x[0]]))
    scene = under(swing, ramp, BodyForce("lower", (1.0, 1.0, 1.0)))
    forest = DISTRIBUTIONS["strewn"](grown(roots(scene), 1))
    sums = WORLD.allreduce(finer_totals(scene, discrete(scene, forest)))
    assert np.allclose(sums, [[0, 0, 0, 6], [4, 0, 0, 4], [0, 0, 0, 0]], rtol=0, atol=1e-12)
    assert body_force(under(swing), discrete(scene, forest)) is None
