"""What contact stores is measured by its own force, and by the energy of its own bodies."""

import numpy as np
from conftest import WORLD, everywhere

from fx_contact import ContactPair, Dirichlet, Material, Scene, Traction, adapt
from fx_contact.scenes import punch
from fx_contact.scenes.boxes import DOWN, LEFT, RIGHT, UP, Boxes
from fx_contact.spots import Spots
from fx_contact.places import Places
from fx_contact.stored import stored_by_forces

DEPTH, THICKNESS, WIDTH, PULL = 1e-5, 0.05, 10.0, 1e-2


def plates(pressed=False, stretched=0.0, joined=False):
    """Two wide thin plates pressed into each other, and a rod apart that stores a thousand times their energy.

    Or a rod in two halves, pressed into each other: a contact pair of its own, or one with the plates.  The lower plate
    may be stretched too.
    """
    boxes = Boxes(1)
    boxes.add("lower", (0.0, 0.0, -THICKNESS), (WIDTH, WIDTH, 0.0), (2, 2, 1))
    boxes.add("upper", (0.0, 0.0, 0.0), (WIDTH, WIDTH, THICKNESS), (2, 2, 1))
    boxes.add("rod", (-3.0, 0.0, 0.0), (-2.0, 1.0, 5.0), (1, 1, 5))
    if pressed:
        boxes.add("rest", (-3.0, 0.0, 5.0), (-2.0, 1.0, 10.0), (1, 1, 5))
    surfaces = {"bottom": boxes.facets(DOWN, -THICKNESS), "top": boxes.facets(UP, THICKNESS, "upper")}
    surfaces |= {"lower face": boxes.facets(UP, 0.0, "lower"), "upper face": boxes.facets(DOWN, 0.0, "upper")}
    surfaces |= {"foot": boxes.facets(DOWN, 0.0, "rod"), "head": boxes.facets(UP, 5.0, "rod")}
    bodies, held = ["lower", "upper", "rod"], {"bottom": 0.0, "top": -DEPTH, "foot": 0.0}
    pairs, loads = [ContactPair("lower face", "upper face", direction=(0, 0, 1))], [Traction("head", (0, 0, PULL))]
    surfaces |= {"left": boxes.facets(LEFT, 0.0, "lower"), "right": boxes.facets(RIGHT, WIDTH, "lower")}
    if pressed:
        surfaces |= {"below": boxes.facets(DOWN, 5.0, "rest"), "end": boxes.facets(UP, 10.0, "rest")}
        bodies, held, loads = [*bodies, "rest"], held | {"end": -10 * PULL}, []
        pairs.append(ContactPair("head", "below", direction=(0, 0, 1)))
    if joined:
        for name, ends in (("up", ("lower face", "head")), ("down", ("upper face", "below"))):
            surfaces[name] = np.concatenate([surfaces[end] for end in ends])
        pairs = [ContactPair("up", "down", direction=(0, 0, 1))]
    return Scene(
        "plates",
        boxes.mesh(surfaces),
        dict.fromkeys(bodies, Material(1.0, 0.0)),
        (
            *(Dirichlet(surface, None if surface == "bottom" else 0.0, 0.0, z) for surface, z in held.items()),
            *(Dirichlet(surface, x=x) for surface, x in (("left", 0.0), ("right", stretched))),
        ),
        tuple(pairs),
        tuple(loads),
    )


def of_spots(step):
    """Spots of the step's closed contact, and what their forces store, twice [J]."""
    spots = Spots(step.forest, step.pairs, step.contact.active)
    return spots, stored(step, step.contact.force, spots.pair, spots.number)


def stored(step, force, group=None, count=None):
    """What the forces of groups store, those of contact pairs if no others are given, twice [J]: (count,)."""
    poisson = np.array([step.scene.materials[body].poisson for body in step.scene.mesh.bodies])
    groups = (step.pairs.contact, len(step.scene.contact)) if group is None else (group, count)
    places = Places(step.pairs, force, *groups)
    return stored_by_forces(step.forest, step.elasticity, poisson, step.estimate, places)


def test_thin_plates_store_less_than_a_half_space():
    """What is in other bodies, however much, is no measure of it."""
    step = next(iter(adapt(plates(), 0.3)))
    force = DEPTH / (2 * THICKNESS) * WIDTH**2
    assert step.estimate.energy_norm**2 > 5 * PULL**2 > 100 * force * DEPTH
    assert abs(stored(step, step.contact.force)[0] / (force * DEPTH) - 1) < 1e-6
    assert stored(step, 0.0 * step.contact.force)[0] == 0


def test_stretched_plates_store_no_more():
    """What a load across the contact's normal stores in its own bodies is no measure of it either."""
    step = next(iter(adapt(plates(stretched=0.1), 0.3)))
    force = DEPTH / (2 * THICKNESS) * WIDTH**2
    assert step.estimate.energy_norm**2 > 1000 * force * DEPTH
    assert 0.99 < stored(step, step.contact.force)[0] / (force * DEPTH) < 1.51


def test_the_stress_that_a_contact_can_cause():
    """It is no less than that of its pressures on a half-space (Boussinesq), and next to nothing beside it."""
    *_, step = adapt(punch(), 0.15)
    pairs, force = step.pairs, step.contact.force
    places = Places(pairs, force, pairs.contact, 1)
    everywhere(len(places.group) < 2 * 17**2, "too many places")
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
            lower = np.flatnonzero(places.body == first)
            nearest = lower[[np.linalg.norm(places.position[lower] - point, axis=1).argmin()]]
            bound = places.stress(nearest, point, np.zeros(1))[0]
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
    assert far["dofs"] == near["dofs"] and abs(far["force"] / near["force"] - 1) < 1e-6
    assert abs(far["pair_errors"][0] / near["pair_errors"][0] - 1) < 1e-4


def test_a_half_space():
    """A punch on a large block stores about what one on a half-space does; parts of the contact store parts of it."""
    *_, step = adapt(punch(), 0.2)
    force, pairs = step.contact.force, step.pairs
    total, approach = pairs.pressing(force, pairs.contact, 1)
    whole = stored(step, force)
    assert abs(whole[0] / (total * approach)[0] - 1) < 0.2
    inner = pairs.position[:, 0] < step.record["contact_radius"] / 2
    assert 0.1 * whole[0] < stored(step, np.where(inner, force, 0.0))[0] < whole[0]
    assert WORLD.allreduce(float(whole[0])) == WORLD.size * whole[0]
