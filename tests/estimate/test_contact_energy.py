"""What contact stores is measured by its own force, and by the energy of its own bodies."""

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import DEPTH, PULL, THICKNESS, WIDTH, plates, stored

from fx_contact import Material, adapt
from fx_contact.estimate.contact_energy import PressureClusters
from fx_contact.scenes import punch

pytestmark = pytest.mark.whole_run


def test_thin_plates_store_less_than_a_half_space():
    """What is in other bodies, however much, is no measure of it."""
    step = next(iter(adapt(plates(), 0.3)))
    force = DEPTH / (2 * THICKNESS) * WIDTH**2
    assert step.estimate.energy_norm**2 > 5 * PULL**2 > 100 * force * DEPTH
    assert abs(stored(step, step.solution.force)[0] / (force * DEPTH) - 1) < 1e-6
    assert stored(step, 0.0 * step.solution.force)[0] == 0


def test_stretched_plates_store_no_more():
    """What a load across the contact's normal stores in its own bodies is no measure of it either."""
    step = next(iter(adapt(plates(stretched=0.1), 0.3)))
    force = DEPTH / (2 * THICKNESS) * WIDTH**2
    assert step.estimate.energy_norm**2 > 1000 * force * DEPTH
    assert 0.99 < stored(step, step.solution.force)[0] / (force * DEPTH) < 1.51


def test_the_stress_that_a_contact_can_cause():
    """It is no less than that of its pressures on a half-space (Boussinesq), and next to nothing beside it."""
    *_, step = adapt(punch(), 0.15)
    pairs, force = step.pairs, step.solution.force
    clusters = PressureClusters(pairs, force, pairs.contact, 1)
    everywhere(len(clusters.patch) < 2 * 17**2, "too many clusters")
    gather = step.forest.comm.allgather
    position, force, area = (
        np.concatenate(gather(values[force > 0])) for values in (pairs.position, force, pairs.area)
    )
    mesh = step.forest.mesh
    first = mesh.body[mesh.surface(step.scene.contact[0].first)[0, 0]]
    turned = [(x, y) for x in (-1, 1) for y in (-1, 1)]  # the whole of a quarter
    position, force = np.concatenate([position * [*turn, 1] for turn in turned]), np.tile(force, 4)
    radius, spacing = np.sqrt(4 * area.sum() / np.pi), np.sqrt(area.max())
    mean = force.sum() / (4 * area.sum())
    for aside in (0.0, 0.5, 1.2, 2.0, 3.0):
        for depth in (0.2, 0.5, 1.0, 2.0):
            if depth * radius < spacing:
                continue
            point = np.array([[aside, 0.0, -depth]]) * radius + [0, 0, position[:, 2].max()]
            lower = np.flatnonzero(clusters.body == first)
            nearest = lower[[np.linalg.norm(clusters.position[lower] - point, axis=1).argmin()]]
            bound = clusters.stress_bound(nearest, point, np.zeros(1))[0]
            exact = (force * 3 * (depth * radius) ** 3 / np.linalg.norm(position - point, axis=1) ** 5).sum() / (
                2 * np.pi
            )
            assert exact < bound * 1.001, (aside, depth)
            assert bound <= (force / np.tile(area, 4)).max() and (aside < 2 or bound < 0.6 * mean), (aside, depth)
            assert aside < 3 or depth > 0.2 or bound < 1e-3 * mean


def test_bodies_that_begin_apart():
    """What is around a contact is so on each body, however far apart they begin: the mesh is the same."""
    soft, stiff = Material(1.0, 0.3), Material(1e3, 0.3)
    near, far = (
        list(adapt(punch(gap=gap, displacement=gap + 0.01, block=stiff, punch=soft), 0.2))[-1].record
        for gap in (0.0, 1.0)
    )
    assert far.dofs == near.dofs and abs(far.force / near.force - 1) < 1e-6
    assert abs(far.pair_errors[0] / near.pair_errors[0] - 1) < 1e-4


def test_a_half_space():
    """A punch on a large block stores about what one on a half-space does; parts of the contact store parts of it."""
    *_, step = adapt(punch(), 0.2)
    force, pairs = step.solution.force, step.pairs
    total, approach = pairs.pressing(force, pairs.contact, 1)
    whole = stored(step, force)
    assert abs(whole[0] / (total * approach)[0] - 1) < 0.2
    inner = pairs.position[:, 0] < step.record.contact_radius / 2
    assert 0.1 * whole[0] < stored(step, np.where(inner, force, 0.0))[0] < whole[0]
    assert WORLD.allreduce(float(whole[0])) == WORLD.size * whole[0]
