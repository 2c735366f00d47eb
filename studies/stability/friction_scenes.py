"""Two hundred load paths with friction, drawn at random so that no rule of the program is tuned to them.

Bodies are pressed together, then moved along the contact, partly back, and in another direction.  Moduli are within
1e4 of each other, coefficients 0.05 to 1.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from fx_contact import (
    ContactPair,
    Dirichlet,
    Pressure,
    RigidCone,
    RigidCylinder,
    RigidPlane,
    RigidSphere,
    Scene,
    SymmetryPlane,
    Traction,
    ball,
    block,
    ring,
    root_mesh_from_shapes,
)
from studies.stability.draws import count, decades, draw
from studies.stability.friction_draws import Draws
from studies.stability.shapes import UP, between, held, on_block

#: Of the random numbers, and paths of each family.
SEED, EACH = 20261, 20


def paths():
    """All load paths by name."""
    families = (_bump, _crests, _ball_on_obstacle, _ball_on_block, _cubes, _stack, _cylinder, _rings, _plate, _stamp)
    drawn = (replace(path, name=f"{path.name}/{k}") for _, k, path in draw(SEED, EACH, families))
    return {path.name: path for path in drawn}


def _curved(name, height, drawn, laws, cells=3, other=None):
    """Function of a motion: a curved body on a block, as `on_block`, its top moved."""
    known = on_block(name, height, cells, 2, 0.0, pairs=len(laws), other=other)
    pairs = [replace(pair, friction=law) for pair, law in zip(known.contact, laws)]

    def scene(motion):
        down, x, y = motion
        conditions = held("base bottom"), Dirichlet(f"{name} top", x, y, -down)
        return replace(known, materials=drawn.materials("base", name), dirichlet=conditions, contact=pairs)

    return scene


def _bump(rng):
    """A body of two curvatures on a block, its pole anywhere."""
    drawn, curvature, (x, y) = Draws(rng, (-2.5, -1.7)), decades(rng, -1.2, -0.8), rng.uniform(-0.4, 0.4, size=2)
    ratio, other = rng.uniform(1.0, 3.0), 4 if count(rng, 0, 1) else None

    def height(here, there):
        return curvature / 2 * ((here - x) ** 2 + ratio * (there - y) ** 2)

    law = drawn.law(0.3 * drawn.soft * np.sqrt(drawn.depth * curvature))
    return drawn.path("bump", "mortar" if other else "pairs", _curved("bump", height, drawn, [law], other=other))


def _crests(rng):
    """A body with two crests, a contact with a law of its own on each."""
    drawn, high, other = Draws(rng), rng.uniform(0.01, 0.03), 6 if count(rng, 0, 1) else None
    slope = drawn.depth * rng.uniform(0.0, 0.7)

    def height(x, y):
        return high * ((x / 0.6) ** 2 - 1) ** 2 + slope * (1 - x / 0.6) / 2 + y**2 / 20

    laws = [drawn.law(0.1 * drawn.soft * drawn.depth**0.5), drawn.other_law()]
    scene = _curved("crests", height, drawn, laws, cells=4, other=other)
    return drawn.path("two contacts", "mortar" if other else "pairs", scene)


def _half_ball(rng, drawn):
    """The lower half of a ball on z = 0, or half of that, its symmetry planes, copies, and the axis that is left."""
    halved = bool(count(rng, 0, 1))
    shape = ball(1.0, 2, 2, 2 if halved else 4).placed(lambda x: (x[0], -x[1], 1.0 - x[2]))
    drawn.how += ["half"] * halved
    return shape, [SymmetryPlane("ball x = 0")] * halved, 1 + halved, 1 if halved else None


def _round_obstacle(rng, socket=True):
    """An obstacle below z = 0 that touches there, or around it, a ball of radius 1 above, and its name."""
    kind, radius = count(rng, 0, 4 if socket else 2), rng.uniform(0.5, 3.0)
    if kind == 0:
        return RigidPlane((0.0, 0.0, 0.0), UP), "plane"
    if kind == 1:
        return RigidSphere((0.0, 0.0, -radius), radius), "sphere"
    if kind == 2:
        return RigidCylinder((0.0, 0.0, -radius), (0.0, 1.0, 0.0), radius), "cylinder"
    if kind == 3:
        return RigidSphere((0.0, 0.0, 1.1 + radius / 3), -1.1 - radius / 3), "socket"
    angle = rng.uniform(40.0, 75.0)
    apex = 1.0 - 1.0 / np.sin(np.radians(angle))
    return RigidCone((0.0, 0.0, float(apex)), (0.0, 0.0, -1.0), 180.0 - angle), "countersink"


def _ball_on_obstacle(rng):
    """A ball on a rigid plane, sphere or cylinder, or in a socket; the ball moves, or the obstacle."""
    drawn = Draws(rng, (-2.3, -1.7))
    shape, planes, copies, along = _half_ball(rng, drawn)
    mesh, law = root_mesh_from_shapes({"ball": shape}), drawn.law(0.3 * drawn.depth**0.5)
    (obstacle, name), moved = _round_obstacle(rng), rng.random() < 0.3
    drawn.ratio = 1.0
    drawn.how += [name, *["the obstacle moves"] * moved]

    def scene(motion):
        down, x, y = motion
        place = (-x, -y, 0.0) if moved else (0.0, 0.0, 0.0)
        top = Dirichlet("ball z = 0", *((0.0, 0.0) if moved else (x, y)), -down)
        pair = ContactPair("ball outside", obstacle, moved=place, friction=law)
        return Scene(name, mesh, drawn.materials("ball"), (top, *planes), pair, symmetry=copies)

    return drawn.path("ball on obstacle", "obstacle", scene, along)


def _ball_on_block(rng):
    """A ball on a block, or in a hollow of it."""
    drawn = Draws(rng, (-2.3, -1.7))
    shape, planes, copies, along = _half_ball(rng, drawn)
    hollow = rng.uniform(0.3, 0.8) if count(rng, 0, 1) else 0.0
    law, low = drawn.law(0.3 * drawn.soft * drawn.depth**0.5), 0 if copies == 2 else -1
    base = block((low, -1, -1), (1, 1, 0), (3 - 3 * (copies == 2) // 2, 3, 2), 2)
    base = base.placed(lambda x: (x[0], x[1], x[2] + (1 + x[2]) * hollow * (x[0] ** 2 + x[1] ** 2) / 2))
    drawn.how += ["hollow"] * (hollow > 0)
    mesh = root_mesh_from_shapes({"ball": shape, "base": base})
    planes += [SymmetryPlane("base left")] * (copies == 2)

    def scene(motion):
        down, x, y = motion
        conditions = Dirichlet("ball z = 0", x, y, -down), held("base bottom"), *planes
        pair = ContactPair("ball outside", "base top", friction=law)
        return Scene("ball", mesh, drawn.materials("ball", "base"), conditions, pair, symmetry=copies)

    return drawn.path("ball on block", "mortar", scene, along)


def _cubes(rng):
    """A block on another one or a plane, its top moved, or pressed by a traction and moved, or loaded by tractions."""
    drawn, kind = Draws(rng), ("pairs", "mortar", "obstacle")[count(rng, 0, 2)]
    high, way, share = rng.uniform(0.3, 1.0), count(rng, 0, 2), rng.uniform(0.2, 0.9)
    high = min(high, 0.4) if way == 2 else high  # or shear would turn it over
    bodies = {"cube": block((0, 0, 0), (1, 1, high), (3, 3, 2) if kind == "mortar" else (2, 2, 2), 1)}
    fixed, moved = [], kind == "obstacle" and way < 2 and bool(count(rng, 0, 1))
    if kind != "obstacle":
        wide = -0.5 if count(rng, 0, 1) and kind == "mortar" else 0.0
        bodies["base"] = block((wide, wide, -1), (1 - wide, 1 - wide, 0), (4, 4, 2) if wide else (2, 2, 2), 1)
        fixed.append(held("base bottom"))
    else:
        drawn.ratio = 1.0
    mesh, pressure = root_mesh_from_shapes(bodies), drawn.soft * drawn.depth
    law, second = drawn.law(pressure), RigidPlane((0.0, 0.0, 0.0), UP) if kind == "obstacle" else "base top"
    drawn.how += [("moved", "traction and moved", "tractions")[way], *["the obstacle moves"] * moved]

    def scene(motion):
        down, x, y = motion
        place, at = ((-x, -y, 0.0), (0.0, 0.0)) if moved else ((0.0, 0.0, 0.0), (x, y))
        load = np.array([0.0, 0.0, -pressure * down / drawn.depth])
        if way == 2:  # below what friction carries: 3 is the largest size of motions over mu times the depth
            load[:2] = share * pressure * 0.7 * np.array([x, y]) / (3.0 * 1.8 * drawn.depth)
        conditions = fixed + [[Dirichlet("cube top", *at, -down)], [Dirichlet("cube top", *at)], []][way]
        loads = [Traction("cube top", tuple(load.tolist()))] * (way > 0)
        pair = ContactPair("cube bottom", second, moved=place, friction=law)
        return Scene("cubes", mesh, drawn.materials(*bodies), conditions, pair, loads)

    return drawn.path("cubes", kind, scene)


def _stack(rng):
    """Three blocks one on another, each contact with a law of its own; friction alone holds the middle one."""
    drawn, kind = Draws(rng), ("pairs", "mortar")[count(rng, 0, 1)]
    middle, thick = (3, 3, 1) if kind == "mortar" else (2, 2, 1), rng.uniform(0.2, 0.6)
    bodies = {
        "lower": block((0, 0, -1), (1, 1, 0), (2, 2, 2), 1),
        "middle": block((0, 0, 0), (1, 1, thick), middle, 1),
        "upper": block((0, 0, thick), (1, 1, 1 + thick), (2, 2, 2), 1),
    }
    mesh, laws = root_mesh_from_shapes(bodies), (
        drawn.law(drawn.soft * drawn.depth),
        drawn.other_law() or drawn.mu / 2,
    )
    pairs = [
        ContactPair("lower top", "middle bottom", UP, friction=laws[0]),
        ContactPair("middle top", "upper bottom", UP, friction=laws[1]),
    ]

    def scene(motion):
        down, x, y = motion
        conditions = held("lower bottom"), Dirichlet("upper top", x, y, -down)
        return Scene("stack", mesh, drawn.materials(*bodies), conditions, pairs)

    return drawn.path("stack", kind, scene)


def _cylinder(rng):
    """A cylinder on a block, a slice in plane strain or a short one; moved across, or in any direction."""
    drawn, curvature, slice_ = Draws(rng, (-2.5, -1.7)), decades(rng, -1.0, -0.3), bool(count(rng, 0, 1))
    other, long = 6 if count(rng, 0, 1) else 4, 0.25 if slice_ else 1.0
    base = block((-1, 0, -1), (1, long, 0), (4, 1 if slice_ else 2, 2), 2)
    body = block((-1, 0, 0), (1, long, 1), (other, 1 if slice_ else 2, 2), 2)
    body = body.placed(lambda x: (x[0], x[1], x[2] + (1 - x[2]) * curvature / 2 * x[0] ** 2))
    mesh, law = root_mesh_from_shapes({"base": base, "bar": body}), drawn.law(0.3 * drawn.soft * drawn.depth**0.5)
    planes = [SymmetryPlane(f"{name} {side}") for name in ("base", "bar") for side in ("front", "back")] * slice_
    drawn.how += ["slice"] * slice_

    def scene(motion):
        down, x, y = motion
        lowest, top = held("base bottom"), Dirichlet("bar top", x, y, -down)
        pair = ContactPair("base top", "bar bottom", UP, friction=law)
        return Scene("cylinder", mesh, drawn.materials("base", "bar"), (lowest, top, *planes), pair)

    return drawn.path("cylinder on block", "pairs" if other == 4 else "mortar", scene, 0 if slice_ else None)


def _rings(rng):
    """A ring, or a rigid shaft, pressed into a hub; then pushed along the axis and turned."""
    drawn, kind = Draws(rng), ("pairs", "mortar", "obstacle")[count(rng, 0, 2)]
    around, long = count(rng, 2, 3), rng.uniform(0.5, 1.5)
    bodies = {"hub": ring(1.0, 2.0, long, (1, around, 2), 2)}
    if kind != "obstacle":
        bodies["shaft"] = ring(0.5, 1.0, long, (1, around + (kind == "mortar"), 2), 2)
    else:
        drawn.ratio = 1.0
    mesh, law = root_mesh_from_shapes(bodies), drawn.law(drawn.soft * drawn.depth)
    second = RigidCylinder((0.0, 0.0, 0.0), UP, 1.0) if kind == "obstacle" else "shaft outside"
    turned = "hub outside" if kind == "obstacle" else "shaft inside"
    fixed = [held("hub outside")] if kind != "obstacle" else []

    def scene(motion):
        down, push, turn = motion
        along = Dirichlet(turned, *(partial(_turned, axis, turn) for axis in (0, 1)), push)
        pair = ContactPair("hub inside", second, clearance=-down, friction=law)
        return Scene("rings", mesh, drawn.materials(*bodies), (*fixed, along), pair)

    return drawn.path("rings", kind, scene)


def _turned(axis, angle, x):
    """Displacement along x or y of a small rotation about z."""
    return angle * (-x[1] if axis == 0 else x[0])


def _plate(rng):
    """A plate below a pressure, on a block or a plane, pulled at its end; perhaps below a second block."""
    drawn, kind = Draws(rng), ("pairs", "mortar", "obstacle")[count(rng, 0, 2)]
    thick, clamped = rng.uniform(0.15, 0.5), bool(count(rng, 0, 1))
    plate = block((0, 0, 0), (3, 1, thick), (6, 3 if kind == "mortar" else 2, 1), 1)
    plate = plate.named("below", "bottom", where=between(0, 2)).named("above", "top", where=between(0, 2))
    bodies, fixed = {"plate": plate}, []
    if kind != "obstacle":
        bodies["base"] = block((0, 0, -1), (2, 1, 0), (4, 2, 2), 1)
        fixed.append(held("base bottom"))
    if clamped:
        bodies["clamp"] = block((0, 0, thick), (2, 1, thick + 0.5), (4, 2, 1), 1)
    pressure, second = drawn.soft * drawn.depth, RigidPlane((0.0, 0.0, 0.0), UP) if kind == "obstacle" else "base top"
    pairs = [ContactPair("plate below", second, friction=drawn.law(pressure))]
    pairs += [ContactPair("plate above", "clamp bottom", friction=drawn.other_law())] * clamped
    mesh, loaded = root_mesh_from_shapes(bodies), "clamp top" if clamped else "plate above"
    drawn.how += ["pressure", *["clamped"] * clamped]

    def scene(motion):
        down, x, y = motion
        conditions = [*fixed, Dirichlet("plate right", x, y, 0.0)] + [Dirichlet("clamp top", 0.0, 0.0)] * clamped
        loads = Pressure(loaded, pressure * down / drawn.depth)
        return Scene("plate", mesh, drawn.materials(*bodies), conditions, pairs, loads)

    return drawn.path("plate", kind, scene)


def _stamp(rng):
    """A rigid sphere, cylinder, cone or tilted plane pressed on a block, moved along it; or the block moves."""
    drawn, moved = Draws(rng, (-2.3, -1.7)), bool(count(rng, 0, 1))
    kind, radius, tilt = count(rng, 0, 3), rng.uniform(0.7, 4.0), rng.uniform(0.0, 0.004)
    centre = (*rng.uniform(-0.3, 0.3, size=2).tolist(), radius)
    obstacle = (
        RigidSphere(centre, radius),
        RigidCylinder(centre, (np.cos(drawn.turn), np.sin(drawn.turn), 0.0), radius),
        RigidCone((*centre[:2], 0.0), UP, rng.uniform(75.0, 85.0)),
        RigidPlane((0.0, 0.0, 0.0), (tilt, 0.0, -1.0)),
    )[kind]
    mesh, law = root_mesh_from_shapes({"block": block((-1, -1, -1), (1, 1, 0), (4, 4, 2), 1)}), drawn.law(0.03)
    drawn.ratio = 1.0
    drawn.how += [obstacle.name, *["the obstacle moves"] * moved]

    def scene(motion):
        down, x, y = motion
        place, at = ((x, y, -down), (0.0, 0.0)) if moved else ((0.0, 0.0, -down), (-x, -y))
        pair = ContactPair("block top", obstacle, moved=place, friction=law)
        return Scene("stamp", mesh, drawn.materials("block"), Dirichlet("block bottom", *at, 0.0), pair)

    return drawn.path("stamp", "obstacle", scene)
