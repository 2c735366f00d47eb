"""Motions that nothing resists: left out where no load drives them, with forces and pressures that need no springs."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from conftest import WORLD

from fx_contact import (
    Beginning,
    BodyForce,
    ContactPair,
    Dirichlet,
    Displacement,
    ErrorControl,
    Material,
    Pressure,
    RigidLoad,
    RigidPlane,
    RigidSphere,
    Scene,
    SolveError,
    Solver,
    ThermalStrain,
    adapt,
    ball,
    block,
    cylinder,
    ring,
    root_mesh_from_shapes,
    solve,
)

pytestmark = pytest.mark.ranks(1, 2, 3)
DEGREES = pytest.mark.parametrize("degree", (1, 2))
SOFT = Material(1000.0, 0.3)
UP = (0.0, 0.0, 1.0)
EVERY = "along x and along y and along z and about x and about y and about z"


def resultant(record, name):
    """The force of a resultant (3,)."""
    (one,) = (one for one in record.resultants if one.name == name)
    return np.array(one.force)


@DEGREES
@pytest.mark.parametrize("preconditioner", (None, "boomeramg", "cholesky"))
def test_a_ring_in_space(degree, preconditioner):
    """Lame's displacement below pressure inside, about an axis that stays where it is; its estimated error is true."""
    mesh = root_mesh_from_shapes({"ring": ring(inner=1, outer=2, length=1, cells=(2, 2, 1))})
    scene = Scene("ring", mesh, {"ring": SOFT}, tractions=Pressure("ring inside", 1.0))
    expected = (0.7 * 2 + 1.3 * 4 / 2) / (1000 * 3)  # p a^2 ((1 - nu) r + (1 + nu) b^2 / r) / (E (b^2 - a^2))
    goals = [Displacement((2.0, 0.0, 0.5), (1, 0, 0), 0.02), Displacement((0.0, -2.0, 0.5), (0, 1, 0), 0.02)]
    record = solve(scene, 0.1, degree=degree, goals=goals, solver=Solver(preconditioner)).record
    assert record.free_motions == {"ring": EVERY} and record.reached
    for goal, sign in zip(record.goals, (1, -1)):
        assert abs(goal.value - sign * expected) < max(1.5 * goal.error, 1e-3 * expected)
    pushed = replace(scene, body_forces=BodyForce("ring", (0, 0, 1e-3)))
    with pytest.raises(SolveError, match="nothing holds body 'ring' along z: a load drives this motion"):
        next(adapt(pushed, 0.5, degree=degree))


def on_block(angle=0, **changes):
    """A ball on a block by its weight, without planes of symmetry; tilted with more cells."""
    shape = tilted_ball(angle) if angle else ball(1.0, 1)
    shapes = {
        "ball": shape.placed(lambda x: (x[0], x[1], x[2] + 1)),
        "base": block((-1.5, -1.5, -1.5), (1.5, 1.5, 0), (3, 3, 2)),
    }
    scene = Scene(
        "ball",
        root_mesh_from_shapes(shapes),
        dict.fromkeys(shapes, SOFT),
        Dirichlet("base bottom", 0, 0, 0),
        ContactPair("ball outside", "base top"),
        body_forces=BodyForce("ball", (0, 0, -1.0)),
    )
    return replace(scene, **changes)


def test_a_ball_by_its_weight():
    """It may spin; its weight arrives at the bottom, without a warning."""
    record = solve(on_block(), 0.2).record
    assert record.free_motions == {"ball": "about x and about y and about z"} and record.reached
    assert resultant(record, "base bottom") == pytest.approx([0, 0, 4 / 3 * np.pi], rel=1e-3, abs=1e-6)
    assert not record.doubts and "body 'ball' is free about x and about y and about z" in str(record)
    lifted = on_block(body_forces=BodyForce("ball", (0, 0, 1.0)))
    with pytest.raises(SolveError, match="nothing holds body 'ball' along z: a load drives this motion"):
        next(adapt(lifted, 0.5))


def box(cells=1, closing=0.05):
    """Eight balls that touch each other and the walls around them, the lid moved down."""
    shapes, contacts = {}, []
    for place in product(range(2), repeat=3):
        name = "ball " + "".join(map(str, place))
        shape = ball(1.0, cells).placed(lambda x, place=place: [x[i] + 2 * place[i] for i in range(3)])
        for axis, high in enumerate(place):
            shape = shape.named("xyz"[axis], "outside")
            point, normal = np.zeros(3), np.zeros(3)
            point[axis], normal[axis] = (3.0, -1.0) if high else (-1.0, 1.0)
            point[2] -= closing * (axis == 2 and high)
            contacts.append(ContactPair(f"{name} {'xyz'[axis]}", RigidPlane(tuple(point), tuple(normal))))
            if not high:
                other = "".join(str(1 if i == axis else value) for i, value in enumerate(place))
                contacts.append(ContactPair(f"{name} outside", f"ball {other} outside"))
        shapes[name] = shape
    return Scene("box", root_mesh_from_shapes(shapes), dict.fromkeys(shapes, SOFT), contact=tuple(contacts))


def test_balls_in_a_box():
    """Each of eight balls may roll; forces are alike by symmetry."""
    scene = box()
    begin = Beginning.uniform(scene, 1, WORLD)
    record = solve(scene, 0.5, beginning=begin, max_steps=1, control=ErrorControl("energy")).record
    assert len(record.free_motions) == 8 and all(
        "about x and about y" in ways for ways in record.free_motions.values()
    )
    forces = zip((pair.name for pair in scene.contact), record.pair_forces)
    down = [force for name, force in forces if "z on rigid" in name]
    assert down == pytest.approx([down[0]] * 8, rel=1e-6) and down[0] > 0.5
    assert not record.doubts and "many directions" not in str(record)


def test_a_roller_in_a_groove():
    """A roller between two planes may shift along its axis: each plane bears its weight over sqrt 2."""
    mesh = root_mesh_from_shapes({"roller": cylinder(1.0, 1.0, (2, 2)).named("right", "outside")})
    planes = (
        ContactPair("roller outside", RigidPlane((-(2**-0.5), -(2**-0.5), 0), (1, 1, 0))),
        ContactPair("roller right", RigidPlane((2**-0.5, -(2**-0.5), 0), (-1, 1, 0))),
    )
    scene = Scene("roller", mesh, {"roller": SOFT}, contact=planes, body_forces=BodyForce("roller", (0, -1.0, 0)))
    record = solve(scene, 0.3).record
    assert record.pair_forces == pytest.approx([np.pi / 2**0.5] * 2, rel=1e-3)
    assert record.free_motions == {"roller": "along z"} and not record.doubts
    with pytest.raises(SolveError, match="nothing holds body 'roller' along z"):
        next(adapt(replace(scene, body_forces=BodyForce("roller", (0, -1.0, 0.1))), 0.5))


def tilted_ball(angle):
    """A shape of a ball whose lowest point is not a node."""
    return ball(1.0, 2).turned("x", angle).turned("y", angle / 2)


@DEGREES
@pytest.mark.parametrize("weight", (0.1, 1e-4))
@pytest.mark.parametrize("angle", (10, 20, 33))
def test_a_roller_between_two_nodes(angle, weight, degree):
    """It rolls to the next line of nodes, or is held by curved cells, which resist a rotation."""
    mesh = root_mesh_from_shapes({"roller": ring(0.4, 1.0, 0.5, (1, 8, 1)).turned("z", angle)})
    plane = ContactPair("roller outside", RigidPlane((0, -1, 0), (0, 1, 0)))
    load = BodyForce("roller", (0, -weight, 0))
    scene = Scene("roller", mesh, {"roller": SOFT}, contact=plane, body_forces=load)
    record = solve(scene, 0.5, degree=degree, max_steps=2).record
    assert record.force == pytest.approx(weight * np.pi * (1 - 0.4**2) / 2, rel=0.02)
    assert record.free_motions["roller"].startswith("along x and along z") and not record.doubts


@DEGREES
@pytest.mark.parametrize("angle, weight", [(10, 0.1), (20, 1e-4)])
def test_a_ball_between_nodes(angle, weight, degree):
    """On a plane and on a block, of which it is free to roll: the reaction is the weight, without inertia."""
    load = BodyForce("ball", (0, 0, -weight))
    plane = ContactPair("ball outside", RigidPlane((0, 0, -1), (0, 0, 1)))
    mesh = root_mesh_from_shapes({"ball": tilted_ball(angle)})
    scenes = Scene("ball", mesh, {"ball": SOFT}, contact=plane, body_forces=load), on_block(angle, body_forces=load)
    for scene in scenes:
        record = solve(scene, 0.5, degree=degree, max_steps=2).record
        assert record.force == pytest.approx(weight * 4 / 3 * np.pi, rel=1e-3)
        assert weight < 0.1 or not record.doubts, "three nodes do not resolve a light ball: it shifts"
    assert resultant(record, "base bottom") == pytest.approx([0, 0, record.force], rel=1e-3, abs=1e-6 * record.force)


def heavier(axis):
    """A weight along an axis that grows with x."""
    return lambda x: np.multiply.outer(-1e-3 * np.eye(3)[axis], 1 + 0.9 * x[0])


@DEGREES
def test_a_ring_that_would_turn(degree):
    """Heavier on one side, beyond the nodes around the point of contact."""
    mesh = root_mesh_from_shapes({"ring": ring(0.5, 1.0, 1.0, (2, 8, 1))})
    plane = ContactPair("ring outside", RigidPlane((0, -1, 0), (0, 1, 0)))
    scene = Scene("ring", mesh, {"ring": SOFT}, contact=plane, body_forces=BodyForce("ring", heavier(1)))
    with pytest.raises(SolveError, match="nothing holds body 'ring'"):
        solve(scene, 0.4, degree=degree, max_steps=2)


def test_a_ball_that_would_turn():
    """Heavier on one side, between the nodes around the point of contact: its cells balance it, which is said."""
    mesh = root_mesh_from_shapes({"ball": ball(1.0, 1)})
    plane = ContactPair("ball outside", RigidPlane((0, 0, -1), (0, 0, 1)))
    scene = Scene("ball", mesh, {"ball": SOFT}, contact=plane, body_forces=BodyForce("ball", heavier(2)))
    record = solve(scene, 0.4, degree=1, max_steps=1).record
    (moment,) = (one.moment for one in record.resultants if one.kind == "balance")
    (doubt,) = (one for one in record.doubts if one.kind == "unbalanced moment")
    assert doubt.value == pytest.approx(np.linalg.norm(moment) / record.force / 2, rel=1e-6)
    assert doubt.value == pytest.approx(0.09, rel=0.01) and doubt.place == "ball"


@DEGREES
def test_a_rigid_load_through_a_free_ball(degree):
    """A load on a rigid face alone: the balance of a body is judged by it."""
    shapes = {
        "ball": ball(1.0, 2),
        "low": block((-1.5, -1.5, -2), (1.5, 1.5, -1), (2, 2, 1)),
        "up": block((-1.5, -1.5, 1), (1.5, 1.5, 2), (3, 3, 1)),
    }
    scene = Scene(
        "press",
        root_mesh_from_shapes(shapes),
        dict.fromkeys(shapes, SOFT),
        (Dirichlet("low bottom", 0, 0, 0), Dirichlet("up left", x=0), Dirichlet("up front", y=0)),
        (ContactPair("ball outside", "low top"), ContactPair("ball outside", "up bottom")),
        rigid_loads=RigidLoad("up top", (0, 0, -9.0)),
    )
    assert solve(scene, 0.5, degree=degree, max_steps=1).record.pair_forces == pytest.approx([9.0, 9.0], rel=0.02)


def test_a_plate_that_rocks():
    """On two of four points below a central load, not where the load beside it closes a third."""
    mesh = root_mesh_from_shapes({"plate": block((0, 0, 0), (3, 3, 1), (3, 3, 1), 1)})
    names = {
        f"at {x} {y}": RigidSphere((x, y, -0.1 - gap), 0.1) for x, y, gap in ((0, 0, 0), (3, 3, 0), (0, 3, 1e-3))
    }
    mesh = replace(mesh, surfaces=mesh.surfaces | {name: mesh.surface("plate bottom") for name in names})
    contacts = tuple(ContactPair(name, sphere) for name, sphere in names.items())
    weight = BodyForce("plate", (0, 0, -1e-3))
    scene = Scene("plate", mesh, {"plate": SOFT}, contact=contacts, body_forces=weight)
    record = solve(scene, 0.9, max_steps=1).record
    assert "about x and about y" in record.free_motions["plate"]
    assert record.pair_forces == pytest.approx([4.5e-3, 4.5e-3, 0], abs=1e-9)
    aside = Pressure("plate top", lambda x: 1e-3 * x[1])  # 0.0135 at (1.5, 2)
    record = solve(replace(scene, tractions=aside), 0.9, max_steps=1).record
    assert "about x" not in record.free_motions["plate"] and "about z" in record.free_motions["plate"]
    assert record.pair_forces == pytest.approx([0.009, 0.01125, 0.00225], rel=1e-6)


def test_a_body_that_gives_way():
    """Below a block that is moved down nothing holds the other one: no force, and a doubt."""
    shapes = {name: block((0, 0, z), (1, 1, z + 1), (2, 2, 2), 1) for z, name in enumerate(("base", "upper"))}
    scene = Scene(
        "blocks",
        root_mesh_from_shapes(shapes),
        dict.fromkeys(shapes, SOFT),
        Dirichlet("upper top", 0, 0, -0.01),
        ContactPair("upper bottom", "base top"),
    )
    record = solve(scene, 0.1, max_steps=1).record
    assert abs(record.force) < 1e-9 and record.estimate == 0
    (doubt,) = record.doubts
    assert doubt.kind == "no contact" and "body 'base' gives way, since nothing holds it" in str(doubt)
    held = replace(scene, dirichlet=(*scene.dirichlet, Dirichlet("base bottom", 0, 0, 0)))
    record = solve(held, 0.1, max_steps=1).record
    assert record.force > 1 and record.free_motions is None and not record.doubts


def stack(count, cells=2, **changes):
    """Cubes on a rigid plane, the uppermost under pressure, that nothing else holds."""
    shapes = {f"cube {n}": block((0, 0, n), (1, 1, n + 1), (cells,) * 3, 1) for n in range(count)}
    pairs = [ContactPair(f"cube {n + 1} bottom", f"cube {n} top") for n in range(count - 1)]
    plane = ContactPair("cube 0 bottom", RigidPlane((0, 0, 0), (0, 0, 1)))
    scene = Scene(
        "stack",
        root_mesh_from_shapes(shapes),
        dict.fromkeys(shapes, SOFT),
        contact=(plane, *pairs),
        tractions=Pressure(f"cube {count - 1} top", 1.0),
    )
    return replace(scene, **changes)


@pytest.mark.parametrize("count, cells, degree", [(2, 2, 2), (2, 1, 1), (2, 3, 1), (4, 2, 1), (5, 1, 2)])
def test_a_stack_on_a_plane(count, cells, degree):
    """Each interface has the load; each cube may shift and turn."""
    record = solve(stack(count, cells), 0.3, degree=degree, max_steps=1).record
    assert record.pair_forces == pytest.approx([1.0] * count, rel=1e-6) and not record.doubts
    assert set(record.free_motions) == {f"cube {n}" for n in range(count)}


def test_a_small_force_beside_large_ones():
    """A body that a small force moves is named, however hard another one is squeezed."""
    squeezed = [Pressure(f"cube 0 {side}", 1e6) for side in ("left", "right")]
    scene = stack(
        2,
        materials={"cube 0": Material(1e10, 0.3), "cube 1": Material(1e10, 0.3)},
        tractions=(*squeezed, Pressure("cube 1 top", 1.0)),
    )
    assert solve(scene, 0.3, max_steps=1).record.pair_forces[1] == pytest.approx(1.0, rel=0.01)
    with pytest.raises(SolveError, match="nothing holds body 'cube 1' along x: a load drives"):
        next(adapt(replace(scene, body_forces=BodyForce("cube 1", (0.1, 0, 0))), 0.3))


def test_a_small_force_beside_a_displacement():
    """Forces of prescribed displacements hide no load that moves bodies across."""
    held = Dirichlet("cube 0 bottom", z=0), Dirichlet("cube 1 top", z=-0.01)
    scene = stack(2, contact=stack(2).contact[1:], tractions=(), dirichlet=held)
    assert "along x" in solve(scene, 0.3, max_steps=1).record.free_motions["cube 1"]
    with pytest.raises(SolveError, match="nothing holds body 'cube 1' along x: a load drives"):
        next(adapt(replace(scene, body_forces=BodyForce("cube 1", (1e-7, 0, 0))), 0.3))


@pytest.mark.parametrize("cells", [1, 2])
def test_a_ball_below_a_lid(cells):
    """Between a plane and a lid with a load: its mean normals at the poles are not quite vertical."""
    shapes = {
        "ball": ball(1.0, cells).placed(lambda x: (x[0], x[1], x[2] + 1)),
        "lid": block((-1.5, -1.5, 2), (1.5, 1.5, 3.5), (2, 2, 1)),
    }
    contacts = ContactPair("lid bottom", "ball outside"), ContactPair("ball outside", RigidPlane((0, 0, 0), UP))
    mesh = root_mesh_from_shapes(shapes)
    scene = Scene("lid", mesh, dict.fromkeys(shapes, SOFT), contact=contacts, tractions=Pressure("lid top", 0.2))
    record = solve(scene, 0.3, degree=1, max_steps=2).record
    assert record.pair_forces == pytest.approx([1.8, 1.8], rel=1e-2)


@DEGREES
def test_an_obstacle_with_a_force_on_a_free_body(degree):
    """Against an equal pressure any place of the obstacle is right; against another it does not settle, or is open."""
    shapes = {"cube": block((0, 0, 0), (1, 1, 1), (2, 2, 2), 1)}
    plane = ContactPair("cube top", RigidPlane((0, 0, 1), (0, 0, -1)), force=(0, 0, -1.0))
    below = Pressure("cube bottom", 1.0)
    scene = Scene("press", root_mesh_from_shapes(shapes), {"cube": SOFT}, contact=plane, tractions=below)
    record = solve(scene, 0.3, degree=degree, max_steps=1).record
    assert record.pair_forces == pytest.approx([1.0], rel=1e-6)
    with pytest.raises(SolveError, match="does not settle|nothing holds"):
        next(adapt(replace(scene, tractions=Pressure("cube bottom", 1.1)), 0.3, degree=degree))


def test_a_warm_body_on_another_one():
    """It expands without stress, and no warning of contact that has rounding alone."""
    scene = stack(2, 1, tractions=(), strains=ThermalStrain("cube 0", 1e-5, 100.0))
    record = solve(scene, 0.3, max_steps=1).record
    assert max(map(abs, record.pair_forces)) < 1e-9 and not [one for one in record.doubts if one.kind == "sliding"]
