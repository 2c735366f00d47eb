"""Model warnings of contact that is not defined where bodies meet, and of loads that do not act as they seem."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import WORLD

from fx_contact import (
    ContactPair,
    Dirichlet,
    Material,
    RigidPlane,
    RigidSphere,
    Scene,
    SymmetryPlane,
    ball,
    block,
    cylinder,
    ring,
    root_mesh_from_shapes,
    solve,
    sweep,
)
from fx_contact.scenes import hertz, indentation
from fx_contact.verdict.scene_warnings import warnings_of

pytestmark = pytest.mark.ranks(1, 2, 3)

STEEL = Material(210e9, 0.3)
LOWER = block((0, 0, 0), (1, 1, 1), (2, 2, 2), 1)


def stack(gap=0.0, covered=1.0, down=0.02, contact=True, turn=0.0):
    """A cube above another one, pressed on its top; the contact surfaces reach from x = 0 to `covered`."""

    def seat(x):
        """The covered part."""
        return x[0] < covered + 1e-9

    lower, upper = LOWER.named("seat", "top", where=seat), LOWER.shifted(z=1 + gap).named(
        "seat", "bottom", where=seat
    )
    mesh = root_mesh_from_shapes({"lower": lower.turned("y", turn), "upper": upper.turned("y", turn)})
    x, z = np.sin(np.radians(turn)), np.cos(np.radians(turn))
    held = Dirichlet("lower bottom", 0.0, 0.0, 0.0), Dirichlet("upper top", -down * x, 0.0, -down * z)
    pairs = ContactPair("lower seat", "upper seat") if contact else ()
    return Scene("stack", mesh, {"lower": STEEL, "upper": STEEL}, held, pairs)


def found(scene, **options):
    """Model warnings of a single step by kind, the same on all ranks."""
    record = solve(scene, 0.5, **{"max_steps": 1} | options).record
    assert WORLD.allgather(record.doubts).count(record.doubts) == WORLD.size
    return {warning.kind: warning for warning in record.doubts}


def test_contact_that_is_not_defined():
    """Four leaf facets of each cube move into the other one; with contact, and bodies that stay apart, none."""
    upper = Dirichlet("upper bottom", 0.0, 0.0, -0.02)
    alone = stack(contact=False)
    scene = replace(alone, dirichlet=(*alone.dirichlet, upper))
    warning = found(scene)["penetration"]
    assert warning.value == 8 and "bodies 'lower' and 'upper'" in warning.message
    assert not found(stack())
    apart = stack(contact=False, gap=0.03)
    assert not found(replace(apart, dirichlet=(*apart.dirichlet, upper)))


@pytest.mark.parametrize("turn", [0.0, 37.0])
@pytest.mark.parametrize("degree", [1, 2])
def test_contact_surface_that_is_too_small(degree, turn):
    """Beyond half of the surface the cubes penetrate each other once the gap is closed there."""
    assert not found(stack(gap=0.001, turn=turn), degree=degree)
    few = found(stack(gap=0.001, covered=0.5, turn=turn), degree=degree)["penetration"]
    assert few.value == 4 and few.limit == 0
    assert not found(stack(gap=0.019, covered=0.5, down=0.0185), degree=degree).keys() - {"no contact"}


def test_bodies_that_come_from_afar():
    """A hundred times their size: 1 % of the way is the thickness of a body."""
    assert not found(stack(gap=100.0, down=100.001), allow=("large strain", "large rotation"))


def test_bodies_of_different_meshes():
    """A ball that rests on a block by a small tie passes into it beside; without motion it does not."""
    foot = ball(0.5, 2, order=3).shifted(0.5, 0.5, 1.5)
    mesh = root_mesh_from_shapes({"block": block((0, 0, 0), (1, 1, 1), (3, 3, 1), 3), "ball": foot})
    materials = {"block": STEEL, "ball": STEEL}
    held = Dirichlet("block bottom", 0.0, 0.0, 0.0)
    for down, count in ((-0.1, True), (0.1, False)):
        moved = Dirichlet("ball outside", 0.0, 0.0, down)
        assert ("penetration" in found(Scene("ball", mesh, materials, (held, moved)), allow="no load")) == count


def cube_below(obstacle, covered, **options):
    """A cube moved up against an obstacle, where the part of its top up to x = `covered` may touch it."""
    mesh = root_mesh_from_shapes({"cube": LOWER.named("seat", "top", where=lambda x: x[0] < covered)})
    held = Dirichlet("cube bottom", 0.0, 0.0, 0.02 * ("force" not in options))
    return Scene("below", mesh, {"cube": STEEL}, held, ContactPair("cube seat", obstacle, **options))


def test_obstacles():
    """Outside of the contact surface a plane does not act, one that a force presses neither."""
    plane = RigidPlane((0, 0, 1.001), (0, 0, -1))
    assert not found(cube_below(plane, 1.1))
    warning = found(cube_below(plane, 0.6))["penetration"]
    assert warning.value == 2 and "body 'cube' and the rigid plane below 'cube seat'" in warning.message
    assert not found(cube_below(plane, 1.1, force=(0, 0, -1e9)))
    assert "penetration" in found(cube_below(plane, 0.6, force=(0, 0, -1e9)))
    assert not found(cube_below(RigidSphere((0.25, 0.5, 1.501), 0.5), 0.6)), "it curves away"


@pytest.mark.parametrize("obstacle", [True, False])
def test_clearance(obstacle):
    """Bodies drawn in touch close a clearance first; what is deeper outside of the contact surfaces counts."""
    upper = block((0, 0, 1), (1, 1, 2), (2, 2, 16), 1).named("seat", "bottom", where=lambda x: x[0] < 0.6)
    shapes = {"upper": upper} if obstacle else {"upper": upper, "lower": block((-1, -1, 0), (2, 2, 1), (3, 3, 1), 1)}
    mesh, end = root_mesh_from_shapes(shapes), RigidPlane((0, 0, 1), (0, 0, 1)) if obstacle else "lower top"
    held = () if obstacle else (Dirichlet("lower bottom", 0.0, 0.0, 0.0),)
    for down, rest in ((-0.13, "penetration"), (-0.101, None)):
        moved = *held, Dirichlet("upper top", 0.0, 0.0, down)
        scene = Scene("clearance", mesh, dict.fromkeys(shapes, STEEL), moved)
        assert not found(replace(scene, contact=ContactPair("upper bottom", end, clearance=0.1)), degree=1)
        few = found(replace(scene, contact=ContactPair("upper seat", end, clearance=0.1)), degree=1)
        assert rest is None or rest in few, few


@pytest.mark.parametrize("side", ["lower", "upper"])
def test_planes_of_symmetry_without_symmetry_planes(side):
    """A `Dirichlet` on one body alone; both of them, and a plane beside two SymmetryPlanes, are none."""
    scene, planes = stack(), {name: Dirichlet(f"{name} left", x=0.0) for name in ("lower", "upper")}

    def with_planes(*more):
        """Half of the scene."""
        return replace(scene, dirichlet=(*scene.dirichlet, *more), symmetry=2)

    (warning,) = warnings_of(with_planes(planes[side]))
    assert warning.kind == "free on a plane" and warning.place in {*planes} - {side}
    assert not warnings_of(with_planes(*planes.values()))
    mirrors = SymmetryPlane("lower front"), SymmetryPlane("upper front")
    assert not warnings_of(with_planes(*mirrors, planes[side]))
    support = Dirichlet(f"{side} right", x=0.0)  # a plane too many, that the other body does not have
    assert not warnings_of(with_planes(*planes.values(), support))


@pytest.mark.parametrize("degrees, oblique", [(8, False), (9, True)])
def test_oblique_direction(degrees, oblique):
    """The limit is the angle with cosine 0.99, 8.1 degrees; the resultant is along the normals."""
    direction = np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))
    scene = stack(down=1e-4)
    kinds = found(replace(scene, contact=replace(scene.contact[0], direction=direction)))
    assert ("oblique direction" in kinds) == oblique
    if oblique:
        assert abs(kinds["oblique direction"].value + np.cos(np.radians(degrees)) - 1) < 1e-6


@pytest.mark.parametrize("cells", [(2, 3), (3, 2)])
def test_direction_from_either_surface(cells):
    """Meshed apart, whichever surface has the rows: along the normal nothing is missing, askew the same share."""
    shapes = {n: block((0, 0, z), (1, 1, z + 1), (k, k, k), 1) for z, (n, k) in enumerate(zip(("low", "up"), cells))}
    held = Dirichlet("low bottom", 0.0, 0.0, 0.0), Dirichlet("up top", 0.0, 0.0, -0.01)
    scene = Scene("apart", root_mesh_from_shapes(shapes), dict.fromkeys(shapes, Material(1.0, 0.3)), held)
    surfaces, forces = ("low top", "up bottom"), set()
    for names, sign in ((surfaces, 1.0), (surfaces[::-1], -1.0)):
        assert not found(replace(scene, contact=ContactPair(*names, direction=(0, 0, sign))), degree=1)
        warning = found(replace(scene, contact=ContactPair(*names, direction=(0.3, 0, sign))), degree=1)
        message = warning["oblique direction"].message
        forces.add(float(message.split("(")[1].split(")")[0].split(",")[-1]) * sign)
        assert warning["oblique direction"].value == pytest.approx(1 - 1 / np.hypot(0.3, 1), rel=0.1)
    assert len(forces) == 1 and min(forces) > 0, "the resultant on the second body"


def test_edges_of_contact():
    """Beside a sharp-edged punch that goes deep, whose leaves are small, nothing is said."""
    assert "penetration" not in found(indentation(displacement=0.05), max_steps=9)


def test_rigid_motion():
    """Bodies that move together, and penetrate each other by less than a hundredth of the way."""
    held = Dirichlet("lower bottom", 0.0, 0.0, -1.0), Dirichlet("upper top", 0.0, 0.0, -1.009)
    scene = replace(stack(contact=False), dirichlet=held)
    assert "penetration" in found(scene)


def test_bore():
    """A shaft of straight-sided leaves in a bore, beside its contact surface, is apart by less than the sagitta."""
    shaft, bore = cylinder(0.95, 1, (2, 1), order=2), ring(1, 2, 1, (2, 2, 1), order=2)
    shapes = {"shaft": shaft.named("low", "outside", where=low), "bore": bore.named("low", "inside", where=low)}
    held = Dirichlet("bore outside", 0.0, 0.0, 0.0), Dirichlet("shaft bottom", 0.0, -0.06, 0.0)
    scene = Scene("bore", root_mesh_from_shapes(shapes), dict.fromkeys(shapes, STEEL), held)
    kinds = found(replace(scene, contact=ContactPair("shaft low", "bore low")))
    assert "penetration" not in kinds
    assert "penetration" in found(scene)


def low(x):
    """The lower half."""
    return x[1] < 1e-9


def test_forgotten_pairs():
    """Half-spheres pole to pole; a body beside that of an obstacle; a surface with a pair of its own."""
    assert "penetration" in found(replace(hertz(coarse=2), contact=()))
    shapes = {"one": LOWER, "two": LOWER.shifted(x=2.0)}
    held = tuple(Dirichlet(f"{name} top", 0.0, 0.0, -0.02) for name in shapes)
    plane = ContactPair("one bottom", RigidPlane((0, 0, 0), (0, 0, 1)))
    scene = Scene("beside", root_mesh_from_shapes(shapes), dict.fromkeys(shapes, STEEL), held, plane)
    assert "body 'two' and the rigid plane" in found(scene)["penetration"].message
    scene = stack(contact=False)
    far = ContactPair("lower top", RigidPlane((0, 0, 1.5), (0, 0, -1)))
    moved = Dirichlet("upper bottom", 0.0, 0.0, -0.02)
    assert "penetration" in found(replace(scene, dirichlet=(*scene.dirichlet, moved), contact=far))


def test_load_path_that_ignores_its_value():
    """Scenes of one value, and plateaus, are solved."""
    assert len(list(sweep(lambda value: stack(), [1.0, 1.0], 0.5, max_steps=1))) == 2
    points = list(sweep(lambda value: stack(down=max(value, 0.02)), [0.01, 0.02, 0.03], 0.5, max_steps=1))
    assert [point.value for point in points] == [0.01, 0.02, 0.03]
    assert str(points[1]).startswith("point 1, value 0.02: begun") and str(points[1].step.record) in str(points[1])
