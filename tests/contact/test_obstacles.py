"""Rigid obstacles against exact solutions."""

from contextlib import nullcontext
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import refined_around
from mpi4py import MPI

from fx_contact import (
    ContactForce,
    ContactPair,
    Dirichlet,
    Enforcement,
    Gap,
    Material,
    MaxPressure,
    Pressure,
    RigidCone,
    RigidCylinder,
    RigidPlane,
    RigidSphere,
    RigidSurface,
    Scene,
    SceneError,
    SymmetryPlane,
    adapt,
    ball,
    block,
    cylinder,
    ring,
    root_mesh_from_shapes,
    solve,
)
from fx_contact.plot import draw_bodies, draw_mesh, plotter_for
from fx_contact.results.contact_surface import contact_grid
from fx_contact.results.report import model_warnings
from fx_contact.scene.fingerprint import item_fields, scene_parts

MATERIAL = Material(young=1.0, poisson=0.3)
FLOOR = RigidPlane((0.3, 0.2, 0.0), (0.0, 0.0, 2.0))

all_ranks = pytest.mark.ranks(1, 2, 3)


def on_obstacle(obstacle, approach=0.01, turn=0.0, cells=(2, 2, 2), **options):
    """A unit block on an obstacle, pressed down by its top; all turned about x by some degrees."""
    mesh = root_mesh_from_shapes({"block": block((0, 0, 0), (1, 1, 1), cells, 1).turned("x", turn)})
    return Scene(
        name="block",
        mesh=mesh,
        materials={"block": MATERIAL},
        dirichlet=(SymmetryPlane("block left"), SymmetryPlane("block front"), Dirichlet("block top", z=-approach)),
        contact=(ContactPair("block bottom", obstacle, **options),),
    )


def ball_on(obstacle, displacement=0.02, order=4, **options):
    """A quarter of a half-ball of radius 1, its pole at the origin, its flat face pressed down."""
    mesh = root_mesh_from_shapes({"ball": ball(1.0, 3, order, octants=1).turned("x", 180).shifted(z=1.0)})
    planes = SymmetryPlane("ball x = 0"), SymmetryPlane("ball y = 0")
    return Scene(
        name="ball",
        mesh=mesh,
        materials={"ball": MATERIAL},
        dirichlet=(*planes, Dirichlet("ball z = 0", z=-displacement)),
        contact=(ContactPair("ball outside", obstacle, **options),),
        symmetry=4,
        contact_centre=(0.0, 0.0, 0.0),
    )


# --------------------------------------------------------------------------------------------------------- geometry

OBSTACLES = {
    "plane": RigidPlane((0.1, 0.2, 0.3), (1.0, 2.0, 2.0)),
    "sphere": RigidSphere((0.1, 0.2, 0.3), 0.7),
    "hollow sphere": RigidSphere((0.1, 0.2, 0.3), -0.7),
    "cylinder": RigidCylinder((0.1, 0.2, 0.3), (1.0, 2.0, 2.0), 0.7),
    "bore": RigidCylinder((0.1, 0.2, 0.3), (1.0, 2.0, 2.0), -0.7),
    "cone": RigidCone((0.1, 0.2, 0.3), (1.0, 2.0, 2.0), 70.0),
    "countersink": RigidCone((0.1, 0.2, 0.3), (1.0, 2.0, 2.0), 120.0),
}


@pytest.mark.parametrize("name", OBSTACLES)
def test_distance_and_normal(name):
    """The normal is the gradient, and leads to the surface: x - g n is on it."""
    obstacle, points = OBSTACLES[name], np.random.default_rng(3).uniform(-2, 2, (500, 3))
    distance, normal = obstacle.distances(points)
    assert (distance > 0).any() and (distance < 0).any()
    assert np.abs(np.linalg.norm(normal, axis=1) - 1).max() < 1e-14
    step = 1e-6 * np.eye(3)
    slopes = [(obstacle.distances(points + d)[0] - obstacle.distances(points - d)[0]) / 2e-6 for d in step]
    assert np.abs(np.stack(slopes, axis=1) - normal).max() < 1e-5
    foot = points - distance[:, None] * normal
    assert np.abs(obstacle.distances(foot)[0]).max() < 1e-12


def test_signs():
    """A negative radius, and an angle above 90 degrees, exchange inside and outside."""
    points = np.random.default_rng(4).uniform(-2, 2, (200, 3))
    for one, other in (("sphere", "hollow sphere"), ("cylinder", "bore")):
        (near, out), (far, into) = OBSTACLES[one].distances(points), OBSTACLES[other].distances(points)
        assert np.array_equal(near, -far) and np.array_equal(out, -into)
    cone = RigidCone((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 60.0)
    hole = RigidCone((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 120.0)
    (near, out), (far, into) = cone.distances(points), hole.distances(points)
    assert np.allclose(near, -far, rtol=0, atol=1e-14) and np.allclose(out, -into, rtol=0, atol=1e-14)
    sphere = RigidSphere((0.0, 0.0, 0.0), 2.0).distances(np.array([[0.0, 0.0, 3.0], [0.0, 1.0, 0.0]]))
    assert np.array_equal(sphere[0], [1.0, -1.0]) and np.array_equal(sphere[1], [[0, 0, 1], [0, 1, 0]])


@pytest.mark.parametrize("name", OBSTACLES)
def test_places_without_a_normal(name):
    """At centres, on axes and at the apex there is a distance and a unit vector."""
    axis = np.array([1.0, 2.0, 2.0]) / 3
    points = np.array([0.1, 0.2, 0.3]) + np.outer([-1.0, 0.0, 1.0], axis)
    distance, normal = OBSTACLES[name].distances(points)
    assert np.isfinite(distance).all() and np.abs(np.linalg.norm(normal, axis=1) - 1).max() < 1e-12
    if isinstance(OBSTACLES[name], RigidCone):
        assert np.allclose(distance, [1.0, 0.0, -1.0], atol=1e-15) and np.allclose(normal, -axis)


# -------------------------------------------------------------------------------------------------- uniform pressure


@all_ranks
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("method", ["exact", "penalty"])
def test_uniform_pressure_on_a_plane(degree, method):
    """A block with hanging nodes on a plane: u = sigma z / E is exact, force, resultant and moment too."""
    scene = on_obstacle(FLOOR)
    begin, enforcement = refined_around(scene, (0, 0, 0)), Enforcement(method)
    step = next(adapt(scene, 0.1, degree=degree, beginning=begin, enforcement=enforcement))
    assert step.record.hanging_nodes > 0
    near = 1e-7 if method == "exact" else 0.01
    assert abs(step.record.pair_forces[0] / 0.01 - 1) < near
    deepest = WORLD.allreduce(float(step.solution.penetration.max(initial=0.0)), op=MPI.MAX)
    assert step.record.max_penetration == deepest and (method == "exact" or deepest > 1e-6)
    off = np.abs(step.contact.pressure / 0.01 - 1).max(initial=0.0)
    everywhere(off < (1e-5 if method == "exact" else 0.05), "not uniform")
    (contact,) = (one for one in step.resultants if one.kind == "contact")
    assert contact.name == "block bottom on rigid plane"
    assert np.allclose(contact.force, (0, 0, -step.record.force), rtol=0, atol=1e-9)
    assert np.abs(contact.moment).max() < 1e-5 * step.record.force
    if method == "exact":
        stress = step.nodal_stress
        everywhere(np.abs(stress[..., 2, 2] / -0.01 - 1).max(initial=0.0) < 1e-5, "stress")


def test_how_far_it_is_pressed():
    """By the top, the obstacle, or interference: the same force; with play less."""
    force = solve(on_obstacle(FLOOR), 0.1).record.force
    moved = on_obstacle(FLOOR, 0.0, moved=(3.0, 0.0, 0.01))
    tight = on_obstacle(FLOOR, 0.0, clearance=-0.01)
    loose = on_obstacle(FLOOR, clearance=0.004)
    for scene, part in ((moved, 1.0), (tight, 1.0), (loose, 0.6)):
        record = solve(scene, 0.1).record
        assert abs(record.force / (part * force) - 1) < 1e-7 and record.reached
        assert not model_warnings(record)


@all_ranks
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("turn", [0.0, 20.0])
def test_held_by_planes_alone(turn, degree):
    """A block without conditions in a corner of three planes, turned about x, below three pressures."""
    t = np.radians(turn)
    out = {"bottom": (0, -np.sin(t), np.cos(t)), "front": (0, np.cos(t), np.sin(t)), "left": (1.0, 0, 0)}
    loads = {"top": 0.01, "back": 0.003, "right": 0.001}
    scene = Scene(
        "corner",
        root_mesh_from_shapes({"block": block((0, 0, 0), (1, 1, 1), (2, 2, 2), 1).turned("x", turn)}),
        {"block": MATERIAL},
        contact=tuple(ContactPair(f"block {side}", RigidPlane((0, 0, 0), normal)) for side, normal in out.items()),
        tractions=tuple(Pressure(f"block {side}", pressure) for side, pressure in loads.items()),
    )
    step = next(adapt(scene, 0.1, degree=degree, beginning=refined_around(scene, (0, 0, 0))))
    assert step.record.hanging_nodes > 0
    assert np.allclose(step.record.pair_forces, [*loads.values()], rtol=1e-5)


# -------------------------------------------------------------------------------------------------------------- Hertz


@all_ranks
def test_a_ball_on_a_plane():
    """Force, radius and largest pressure of Hertz, E* = E/(1 - nu^2), of the radius; goals are reached."""
    scene = ball_on(FLOOR, 0.01)
    name = "ball outside on rigid plane"
    goals = ContactForce(name, 0.01), MaxPressure(name, 0.03), Gap(name, (0.3, 0.0, 0.046), 0.05)
    step = solve(scene, 0.03, goals=goals)
    record = step.record
    assert record.reached and all(goal.reached for goal in record.goals)
    modulus = MATERIAL.plane_strain_modulus
    radius = (0.75 * record.force / modulus) ** (1 / 3)
    assert abs(record.contact_radius / radius - 1) < 0.02
    assert abs(record.max_pressure / (1.5 * record.force / np.pi / radius**2) - 1) < 0.03
    totals = {(one.name, one.kind): np.array(one.force) for one in step.resultants}
    pressed = totals[name, "contact"]
    assert abs(-pressed[2] / record.force - 1) < 1e-9 and np.abs(pressed[:2]).max() < 1e-12
    assert abs(totals["ball z = 0", "reaction"][2] / pressed[2] - 1) < 1e-6
    top = WORLD.allreduce(float(contact_grid(step)["pressure"].max(initial=0.0)), op=MPI.MAX)
    assert abs(top / record.max_pressure - 1) < 0.02


@all_ranks
def test_a_ball_pressed_into_a_block():
    """Hertz on a block 60 contact radii wide, which is softer by its finite height; E* of the block alone."""
    radius, depth = 1.0, 1e-3
    mesh = root_mesh_from_shapes({"block": block((0, 0, -1), (1, 1, 0), (3, 3, 3), 1)})
    held = SymmetryPlane("block left"), SymmetryPlane("block front"), Dirichlet("block bottom", z=0.0)
    ball = RigidSphere((0.0, 0.0, radius), radius)
    pair = ContactPair("block top", ball, direction=(0.0, 0.0, 1.0), moved=(0.0, 0.0, -depth))
    scene = Scene("ball on block", mesh, {"block": MATERIAL}, held, (pair,), symmetry=4)
    record = solve(scene, 0.05, degree=2).record
    modulus = MATERIAL.plane_strain_modulus
    assert record.reached
    contact_radius = (0.75 * record.force * radius / modulus) ** (1 / 3)
    assert abs(record.contact_radius / contact_radius - 1) < 0.03
    assert abs(record.max_pressure / (1.5 * record.force / np.pi / contact_radius**2) - 1) < 0.05
    assert abs(record.force / (4 / 3 * modulus * depth**1.5) - 1) < 0.1


def test_three_ways_to_say_a_ball():
    """The force of a ball is (1 - 2 nu) a / (pi (1 - nu) R) above that of vertical normals, to first order in a / R.

    The surface moves inward by u = (1 - 2 nu) (1 + nu) a^2 p_0 (1 - (1 - r^2 / a^2)^1.5) / (3 E r) (K. L. Johnson,
    Contact Mechanics, 1985, equation 3.41b), and the slope is r / R: the energy grows by the integral of p u r / R,
    which is proportional to the third power of the approach, and the force by its derivative.
    """
    depth, nu, shape = 0.01, MATERIAL.poisson, block((0, 0, -1), (1.6, 1.6, 0), (4, 4, 3), 1)
    held = SymmetryPlane("block left"), SymmetryPlane("block front"), Dirichlet("block bottom", 0.0, 0.0, 0.0)
    scene = Scene("ball", root_mesh_from_shapes({"block": shape}), {"block": MATERIAL}, held, symmetry=4)

    def down(x):
        return np.stack([0 * x[0], 0 * x[0], 0 * x[0] - 1])

    ball, parabola, vertical = (
        solve(replace(scene, contact=ContactPair("block top", way, moved=(0, 0, -depth))), 0.05).record.force
        for way in (
            RigidSphere((0.0, 0.0, 1.0), 1.0),
            RigidSurface(lambda x: (x[0] ** 2 + x[1] ** 2) / 2 - x[2], down),
            RigidSurface(lambda x: 1 - np.sqrt(np.maximum(1 - x[0] ** 2 - x[1] ** 2, 0.0)) - x[2], down),
        )
    )
    ratio = 0.103  # a / R
    assert ball / parabola - 1 == pytest.approx((1 - 2 * nu) / (np.pi * (1 - nu)) * ratio, rel=0.2)
    assert abs(vertical / parabola - 1) < ratio**2 / 4


# -------------------------------------------------------------------------------------------------- bores and pins


def ring_scene(obstacle, **options):
    """A quarter of a slice of a ring, radii 1 and 2, in plane strain, on a pin."""
    mesh = root_mesh_from_shapes({"ring": ring(1.0, 2.0, 0.25, (3, 3, 1), 4, quarters=1)})
    planes = tuple(SymmetryPlane(f"ring {side}") for side in ("x = 0", "y = 0", "bottom", "top"))
    pair = ContactPair("ring inside", obstacle, **options)
    return Scene("ring", mesh, {"ring": MATERIAL}, planes, (pair,), symmetry=4)


def bolt_scene(obstacle, **options):
    """A quarter of a slice of a cylinder of radius 1, in plane strain, in a bore."""
    mesh = root_mesh_from_shapes({"bolt": cylinder(1.0, 0.25, (2, 1), 4, quarters=1)})
    planes = tuple(SymmetryPlane(f"bolt {side}") for side in ("x = 0", "y = 0", "bottom", "top"))
    pair = ContactPair("bolt outside", obstacle, **options)
    return Scene("bolt", mesh, {"bolt": MATERIAL}, planes, (pair,), symmetry=4)


@all_ranks
@pytest.mark.parametrize("given", ["radius", "clearance"])
def test_shrunk_on_a_pin(given):
    """Lame: u = p (1 + nu)/E ((1 - 2 nu) a^2 + b^2) a / (b^2 - a^2); interference of the radius or as a number."""
    depth, (young, nu) = 1e-3, (MATERIAL.young, MATERIAL.poisson)
    radius, clearance = (1 + depth, 0.0) if given == "radius" else (1.0, -depth)
    scene = ring_scene(RigidCylinder((0.0, 0.0, 5.0), (0.0, 0.0, 1.0), radius), clearance=clearance)
    step = solve(scene, 0.01, degree=2)
    pressure = depth * young / (1 + nu) * 3 / (1 - 2 * nu + 4)
    assert abs(step.record.max_pressure / pressure - 1) < 0.01
    assert abs(step.record.force / (pressure * 2 * np.pi * 0.25) - 1) < 1e-3
    everywhere(step.contact.active.all(), "open")


@all_ranks
def test_a_bolt_in_a_bore():
    """Interference in a bore, of negative radius: u = -p (1 + nu)(1 - 2 nu) a / E; with play there is no force."""
    depth, nu = 1e-3, MATERIAL.poisson
    bore = RigidCylinder((0.0, 0.0, 0.0), (0.0, 0.0, -2.0), -1.0)
    step = solve(bolt_scene(bore, clearance=-depth), 0.01, degree=2)
    pressure = depth * MATERIAL.young / (1 + nu) / (1 - 2 * nu)
    assert abs(step.record.max_pressure / pressure - 1) < 0.01
    assert abs(step.record.force / (pressure * 2 * np.pi * 0.25) - 1) < 1e-3
    loose = bolt_scene(bore, clearance=depth)
    record = next(adapt(loose, 0.1, allow=("no load",))).record
    assert record.force == 0 and record.active_pairs == 0


def test_a_cone():
    """Love: F = 2 E* tan(angle) delta^2 / pi, on a block 30 contact radii wide; as a surface by functions the same."""
    depth, angle = 1e-3, 86.0
    mesh = root_mesh_from_shapes({"block": block((0, 0, -1), (1, 1, 0), (3, 3, 3), 1)})
    held = SymmetryPlane("block left"), SymmetryPlane("block front"), Dirichlet("block bottom", z=0.0)
    cone = RigidCone((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), angle)
    surface = RigidSurface(lambda x: cone.distances(x.T)[0], lambda x: 3 * cone.distances(x.T)[1].T)
    scenes = [
        Scene("cone", mesh, {"block": MATERIAL}, held, (pair,), symmetry=4)
        for pair in (ContactPair("block top", one, (0, 0, 1), moved=(0.0, 0.0, -depth)) for one in (cone, surface))
    ]
    one, other = (solve(scene, 0.08, degree=2).record for scene in scenes)
    assert one.cells == other.cells and abs(one.force / other.force - 1) < 1e-9
    assert one.reached and one.contact_radius is None
    love = 2 / np.pi * MATERIAL.plane_strain_modulus * np.tan(np.radians(angle)) * depth**2
    assert abs(one.force / love - 1) < 0.06


# ------------------------------------------------------------------------------------------------------- adaptivity


@all_ranks
@pytest.mark.parametrize("degree", [1, 2])
def test_contact_between_nodes_is_found(degree):
    """A small ball presses the middle of a facet, whose nodes are all away from it."""
    scene = on_obstacle(RigidSphere((0.4, 0.35, -0.05), 0.05), 0.003, cells=(1, 1, 1), clearance=1e-12)
    steps = list(adapt(scene, 0.3, degree=degree, max_steps=7))
    assert steps[0].record.active_pairs == 0 and steps[0].record.penetrated_leaves == 1
    assert steps[-1].record.force > 0 and steps[-1].record.penetrated_leaves == 0


@all_ranks
def test_pictures(folder):
    """Obstacles, by functions too, are drawn where they have moved to; what is in the body is drawn larger with it."""
    ball, floor = RigidSphere((0, 0, -1), 1.0), RigidSurface(lambda x: x[2], upward)
    away, force = RigidSphere((0, 0, -1.2), 1.0), (0.0, 0.0, 1e-3)
    pressed = on_obstacle(away, 0.0, force=force)
    scenes = [on_obstacle(one, 0.0, moved=(0.0, 0.0, 0.01)) for one in (ball, floor)]
    for scene in (*scenes, pressed):
        step = next(adapt(scene, 0.1))
        depth = 0.01 if scene is not pressed else next(iter(step.record.motions.values())) - 0.2
        assert depth > 0.005
        for draw, factor in ((partial(draw_bodies, factor=10.0), 10.0), (partial(draw_mesh, zoom=9.0), 0.0)):
            with plotter_for(folder / "obstacle.png") if WORLD.rank == 0 else nullcontext() as plotter:
                draw(step, plotter=plotter)
                actors = plotter.actors.values() if plotter else ()
                tops = [actor.bounds[5] for actor in actors if hasattr(actor, "mapper")]  # of bodies, not of texts
            everywhere(WORLD.rank > 0 or min(abs(top - factor * depth) for top in tops) < 1e-3, "not there")


def upward(x):
    """The z axis at points (3, n)."""
    return np.stack([0 * x[0], 0 * x[0], 1 + 0 * x[0]])


# ---------------------------------------------------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: RigidPlane((0, 0, 0), (0, 0, 0)), "normal of a rigid plane is zero"),
        (lambda: RigidPlane((0, 0), (0, 0, 1)), "three components"),
        (lambda: RigidSphere((0, 0, 0), 0.0), "radius of a rigid sphere is zero"),
        (lambda: RigidSphere((0, np.nan, 0), 1.0), "finite"),
        (lambda: RigidCylinder((0, 0, 0), (0, 0, 0), 1.0), "axis of a rigid cylinder is zero"),
        (lambda: RigidCylinder((0, 0, 0), (0, 0, 1), np.inf), "finite"),
        (lambda: RigidCone((0, 0, 0), (0, 0, 1), 90), "not 90"),
        (lambda: RigidCone((0, 0, 0), (0, 0, 1), -5), "0 to 180"),
        (lambda: RigidCone((0, 0, 0), (0, 0, 1), 180), "0 to 180"),
        (lambda: RigidSurface(1.0, lambda x: x), "must be a function"),
        (lambda: ContactPair("a", FLOOR, clearance="much"), "clearance"),
        (lambda: ContactPair("a", FLOOR, moved=1.0), "three components"),
        (lambda: on_obstacle(RigidSphere((0.5, 0.5, 0.5), 3.0)), "100% of body 'block' is inside the obstacle"),
        (lambda: on_obstacle(RigidSphere((0.5, 0.5, -0.8), -1.0)), "9.% of body 'block' is inside the obstacle"),
        (lambda: on_obstacle(RigidCylinder((0.5, 0, -0.6), (0, 1, 0), -1.0)), "6.% of body 'block' is inside"),
        (lambda: on_obstacle(RigidSphere((0.3, 0.3, 0.3), -0.2)), "is inside the obstacle"),
        (lambda: on_obstacle(RigidPlane((0, 0, -2.5), (0, 0, 1))), "2.5 away from the surface"),
        (lambda: with_contacts(ContactPair("block top", FLOOR)), "looks away from the obstacle"),
        (lambda: on_obstacle(RigidSurface(lambda x: x[2], lambda x: x[2])), "normal of a rigid surface .* shape"),
        (lambda: on_obstacle(RigidSurface(lambda x: x[2] / 0, lambda x: x)), "finite"),
        (lambda: on_obstacle(RigidSurface(lambda x: x[2], lambda x: 0 * x)), "normal of a rigid surface is zero"),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero", "ignore:invalid value")
def test_bad_input(make, message):
    with pytest.raises(SceneError, match=message):
        make()


@pytest.mark.parametrize(
    "obstacle, options",
    [
        (RigidPlane((0, 0, 0.2), (0, 0, 1)), {}),
        (RigidSphere((0.5, 0.5, -0.8), 1.0), {}),
        (RigidSphere((0.5, 0.5, 0.5), 1.0), {"moved": (0.0, 0.0, -1.5)}),
        (RigidPlane((0, 0, 0), (0, 0, 1)), {"moved": (0.0, 0.0, 0.9)}),
    ],
)
def test_interference(obstacle, options):
    """A body may begin inside an obstacle in part, and an obstacle may be moved to its place, or through a body."""
    assert on_obstacle(obstacle, **options).contact[0].second == obstacle


def with_contacts(*contacts):
    """The block with other contacts."""
    return replace(on_obstacle(FLOOR), contact=contacts)


@all_ranks
def test_two_obstacles_on_one_facet():
    """A surface in two pairs, in a groove of two planes, as its halves in one each; the same pair twice is an error."""
    shape = ball(1.0, 2, 3, octants=2).placed(lambda x: (x[0], -x[1], -x[2]))
    shape = shape.named("left", "outside", where=lambda x: x[1] < 1e-9).named(
        "right", "outside", where=lambda x: x[1] > -1e-9
    )
    mesh = root_mesh_from_shapes({"ball": shape.named("again", "outside")})
    held = Dirichlet("ball z = 0", 0.0, 0.0, -0.01), SymmetryPlane("ball x = 0")
    forces = []
    for names in (("ball outside", "ball again"), ("ball left", "ball right")):
        planes = (RigidPlane((0, sign * 2**-0.5, -(2**-0.5)), (0, -sign, 1)) for sign in (-1, 1))
        pairs = [ContactPair(name, plane) for name, plane in zip(names, planes)]
        step = adapt(Scene("groove", mesh, {"ball": MATERIAL}, held, pairs, symmetry=2), 0.3, degree=1, max_steps=2)
        forces.append([one.force for one in step.last_step().record.resultants if one.kind == "contact"])
    (_, y, z), (_, other, same) = forces[0]
    assert (
        np.allclose(*forces, rtol=1e-8, atol=1e-8 * abs(z))
        and y == pytest.approx(-other)
        and z == pytest.approx(same)
    )
    assert abs(y) == pytest.approx(abs(z)) and z < 0
    with pytest.raises(SceneError, match="two contacts have the name .*: name a surface anew"):
        with_contacts(*2 * [ContactPair("block bottom", FLOOR)])


@all_ranks
@pytest.mark.parametrize("degree", [1, 2])
def test_two_obstacles_on_one_side(degree):
    """Two planes at one height, each below half of a side: the nodes between them are in rows of both, as in one."""
    body = block((0, 0, 0), (1, 1, 1), (2, 2, 2), 1)
    for name, low in (("one", 0.0), ("other", 0.5)):
        body = body.named(name, "bottom", where=lambda x, low=low: (x[0] > low - 1e-9) & (x[0] < low + 0.5 + 1e-9))
    mesh, whole = root_mesh_from_shapes({"block": body}), on_obstacle(FLOOR)
    other = RigidPlane((5.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    halves = replace(whole, mesh=mesh, contact=(ContactPair("block one", FLOOR), ContactPair("block other", other)))
    one, two = (solve(scene, 0.1, degree=degree) for scene in (whole, halves))
    assert len(two.record.pair_forces) == 2 and min(two.record.pair_forces) > 0
    assert abs(sum(two.record.pair_forces) / one.record.force - 1) < 1e-9
    assert abs(two.record.max_pressure / one.record.max_pressure - 1) < 1e-6


@all_ranks
def test_a_function_that_fails_later():
    """Not finite at some points only, on one rank: an error on all."""
    scene = on_obstacle(RigidSurface(lambda x: np.where(count(x), np.nan, x[2]), upward))
    with pytest.raises(SceneError, match="gap of a rigid surface is nan"):
        list(adapt(scene, 0.1))


def count(x):
    """Points that no root cell has as a sample, but a leaf as a node."""
    return (np.abs(x[0] - 0.25) < 1e-9) & (np.abs(x[1] - 0.25) < 1e-9)


@pytest.mark.parametrize("name", OBSTACLES)
def test_every_number_of_an_obstacle_counts(name):
    """A scene with another point, radius, displacement or play is another one for a restart."""
    mesh = root_mesh_from_shapes({"a": block((0, 0, 0), (1, 1, 1), (1, 1, 1), 1)})
    pair = ContactPair("a top", OBSTACLES[name])
    others = [replace(pair, moved=(0, 0, 1.0)), replace(pair, clearance=1.0), replace(pair, direction=(0, 0, 1.0))]
    others.append(replace(pair, force=(0, 0, 1.0)))
    for field, value in vars(OBSTACLES[name]).items():
        changed = (value[0] + 0.5, *value[1:]) if isinstance(value, tuple) else 1.1 * value
        others.append(replace(pair, second=replace(OBSTACLES[name], **{field: changed})))
    assert all(item_fields(mesh, other) != item_fields(mesh, pair) for other in others)
    pairs = [ContactPair("a top", one) for one in OBSTACLES.values()]
    assert len({tuple(item_fields(mesh, one)) for one in pairs}) == len(OBSTACLES)


def test_functions_of_an_obstacle_count():
    """By their values on the surface."""

    def scene(height, tilt=0.0):
        return on_obstacle(
            RigidSurface(lambda x: x[2] + height, lambda x: np.stack([tilt + 0 * x[0], 0 * x[0], 1 + 0 * x[0]]))
        )

    parts = scene_parts(scene(0.0))
    assert scene_parts(scene(0.0)) == parts
    assert scene_parts(scene(0.01)) != parts != scene_parts(scene(0.0, 0.1))
