"""Forces and moments on surfaces that stay rigid: against exact bending, torsion and prescribed motions."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import everywhere
from model_problems import EXACT

from fx_contact import (
    ContactPair,
    Dirichlet,
    Material,
    Pressure,
    RigidLoad,
    RigidMotion,
    RigidPlane,
    Scene,
    SceneError,
    SolveError,
    SymmetryPlane,
    adapt,
    block,
    root_mesh_from_shapes,
    solve,
)
from fx_contact.scene.fingerprint import scene_parts

PARALLEL = pytest.mark.ranks(1, 2, 3)
DEGREES = pytest.mark.parametrize("degree", (1, 2))
YOUNG, LENGTH = 100.0, 4.0
PLAIN, STEEL = Material(YOUNG, 0.0), Material(YOUNG, 0.3)
FORCE, MOMENT = (0.02, -0.01, 0.03), (0.01, 0.02, -0.03)


def bar(load, material=PLAIN, held=None, cells=(2, 2, 8), **options):
    """A bar of the unit square along z, clamped at its lower end."""
    mesh = root_mesh_from_shapes({"bar": block((-0.5, -0.5, 0), (0.5, 0.5, LENGTH), cells, 1)})
    held = Dirichlet("bar bottom", 0.0, 0.0, 0.0) if held is None else held
    return Scene("bar", mesh, {"bar": material}, held, rigid_loads=load, **options)


def resultant(step, name):
    """Force and moment about `point` of the record, by name: (6,), and the point."""
    (one,) = [one for one in step.record.resultants if one.name == name]
    return np.array([*one.force, *one.moment]), np.array(one.point)


@PARALLEL
@DEGREES
def test_tension_and_bending(degree):
    """At nu = 0: elongation F L / (E A), end rotation M L / (E I) with I = 1/12, exact at degree 2; reactions."""
    load = RigidLoad("bar top", force=(0, 0, 0.5), moment=(0.02, -0.01, 0))
    step = solve(bar(load), 0.5, degree=degree, solver=EXACT)
    *_, elongation, about_x, about_y, about_z = step.record.motions["bar top"]
    assert elongation == pytest.approx(0.5 * LENGTH / YOUNG, rel=1e-8) and abs(about_z) < 1e-10
    bent = np.array([about_x, about_y]) / (np.array([0.02, -0.01]) * LENGTH / (YOUNG / 12))
    assert bent == pytest.approx(1, rel=1e-7 if degree == 2 else 0.2)
    found, point = resultant(step, "bar top")
    arm = np.array([0, 0, LENGTH]) - point
    known = np.array([0, 0, 0.5, *(np.array([0.02, -0.01, 0]) + np.cross(arm, [0, 0, 0.5]))])
    assert found == pytest.approx(known, abs=1e-8)
    clamp, _ = resultant(step, "bar bottom")
    assert clamp == pytest.approx(-known, abs=1e-8)
    balance, _ = resultant(step, "bar")
    assert np.abs(balance).max() < 1e-8


@PARALLEL
@pytest.mark.parametrize("point", [None, (1.0, -2.0, 3.0)])
def test_motion_is_that_of_prescribed_forces(point):
    """All six components, about any point: prescribing the motion that is found gives reactions F and M."""
    load = RigidLoad("bar top", FORCE, MOMENT, point)
    step = solve(bar(load, STEEL, cells=(2, 2, 4)), 0.2, solver=EXACT, max_steps=2)
    motion = step.record.motions["bar top"]
    centre = (0.0, 0.0, LENGTH) if point is None else point
    held = Dirichlet("bar bottom", 0.0, 0.0, 0.0), RigidMotion("bar top", motion[:3], motion[3:], centre)
    again = solve(replace(step.scene, dirichlet=held, rigid_loads=()), 0.2, solver=EXACT, max_steps=2)
    assert again.record.cells == step.record.cells
    found, about = resultant(again, "bar top")
    moment = np.array(MOMENT) + np.cross(np.array(centre) - about, FORCE)
    assert found == pytest.approx([*FORCE, *moment], rel=1e-6, abs=1e-8)
    position, u = step.elasticity.prolongation.space.positions(), step.elasticity.prolongation
    there = np.abs(position[:, 2] - LENGTH) < 1e-9
    moved = u.prolong(step.solution.displacement)[there]
    rigid = np.array(motion[:3]) + np.cross(motion[3:], position[there] - centre)
    everywhere(np.abs(moved - rigid).max(initial=0) < 1e-9, "the surface is not rigid")


@PARALLEL
def test_far_point():
    """A moment about a point 1e6 sizes away is that about the centroid with M + r x F: the same motion."""
    far, centre = np.array([2e6, 1e6, 0.0]), np.array([0.0, 0.0, LENGTH])
    loads = [
        RigidLoad("bar top", FORCE, MOMENT),
        RigidLoad("bar top", FORCE, np.array(MOMENT) - np.cross(far - centre, FORCE), far),
    ]
    near, other = (solve(bar(load, STEEL, cells=(2, 2, 4)), 0.2, solver=EXACT, max_steps=1).record for load in loads)
    motion, rotation = np.array(near.motions["bar top"]).reshape(2, 3)
    assert other.motions["bar top"][3:] == pytest.approx(rotation, rel=1e-8)
    assert other.motions["bar top"][:3] == pytest.approx(motion + np.cross(rotation, far - centre), rel=1e-8)


@PARALLEL
@pytest.mark.parametrize("slenderness", (20, 100, 300))
def test_slender_cantilever(slenderness):
    """The tip of a beam moves by F L^3 / (3 E I) and turns by F L^2 / (2 E I), however slender; shear adds 0.2 %."""
    length = float(slenderness)
    mesh = root_mesh_from_shapes({"bar": block((0, 0, 0), (1, 1, length), (1, 1, 20), 1)})
    load = RigidLoad("bar top", (1e-6, 0, 0))
    scene = Scene("beam", mesh, {"bar": PLAIN}, Dirichlet("bar bottom", 0.0, 0.0, 0.0), rigid_loads=load)
    motion = next(adapt(scene, 0.9)).record.motions["bar top"]
    bending = YOUNG / 12
    assert motion[0] == pytest.approx(1e-6 * length**3 / (3 * bending), rel=0.005)
    assert motion[4] == pytest.approx(1e-6 * length**2 / (2 * bending), rel=0.005)


@PARALLEL
def test_half_model():
    """Half of a bar with a symmetry plane has the motion of the whole; forces are of the whole."""
    load = RigidLoad("bar top", (0, 0.02, 0.1), (0.01, 0, 0), (0.0, 0.0, LENGTH))
    whole = solve(bar(load, STEEL, cells=(2, 2, 4)), 0.3, solver=EXACT, max_steps=1)
    mesh = root_mesh_from_shapes({"bar": block((0, -0.5, 0), (0.5, 0.5, LENGTH), (1, 2, 4), 1)})
    held = Dirichlet("bar bottom", 0.0, 0.0, 0.0), SymmetryPlane("bar left")
    half = Scene("half", mesh, {"bar": STEEL}, held, rigid_loads=load, symmetry=2)
    step = solve(half, 0.3, solver=EXACT, max_steps=1)
    assert step.record.motions["bar top"] == pytest.approx(whole.record.motions["bar top"], rel=1e-6, abs=1e-9)
    assert resultant(step, "bar top")[0][:3] == pytest.approx((0, 0.02, 0.1), abs=1e-8)
    lever = np.array([0.0, 0.0, 1e5 - LENGTH])
    moment = np.array(load.moment) - np.cross(lever, load.force)
    far = solve(
        replace(half, rigid_loads=RigidLoad("bar top", load.force, moment, (0.0, 0.0, 1e5))), 0.3, max_steps=1
    )
    assert far.record.motions["bar top"][3:] == pytest.approx(step.record.motions["bar top"][3:], rel=1e-6, abs=1e-9)
    rollers = replace(half, dirichlet=(held[0], Dirichlet("bar left", x=0.0)))
    other = solve(rollers, 0.3, solver=EXACT, max_steps=1)
    assert other.record.motions["bar top"] == pytest.approx(step.record.motions["bar top"], rel=1e-8, abs=1e-10)
    for scene in (half, rollers):
        for wrong in ({"force": (0.1, 0, 0)}, {"moment": (0, 0.1, 0)}):
            with pytest.raises(SceneError, match="symmetry planes"):
                replace(scene, rigid_loads=replace(load, **wrong))


@PARALLEL
def test_hinged_lever():
    """A lever about an edge, free until it meets a plane, which bears F L / L; each motion alone meets the hinge."""
    bar_along_x = block((0, -0.5, 0), (LENGTH, 0.5, 1), (4, 1, 1), 1)
    bar_along_x = bar_along_x.named("foot", "bottom", where=lambda x: (x[0] > 1.9) & (x[0] < 3.1))
    hinge = ("bar", lambda x: np.abs(x[[0, 2]]).max(axis=0) < 1e-9)
    mesh = root_mesh_from_shapes({"bar": bar_along_x}, curves={"hinge": hinge})
    pair = ContactPair("bar foot", RigidPlane((0, 0, -0.01), (0, 0, 1)))
    held = Dirichlet("hinge", 0.0, 0.0, 0.0)
    load = RigidLoad("bar right", (0, 0, -0.02), point=(LENGTH, 0, 0.5))
    scene = Scene("lever", mesh, {"bar": STEEL}, held, pair, rigid_loads=load)
    step = solve(scene, 0.3, solver=EXACT, max_steps=1)
    centre = np.array(step.record.contact_centre)
    assert step.record.force == pytest.approx(0.02 * LENGTH / centre[0], rel=1e-6)


@PARALLEL
def test_above_contact():
    """A block pressed onto a rigid plane by a rigid load: contact and load are equal; a cap of no load stays rigid."""
    mesh = root_mesh_from_shapes({"block": block((0, 0, 0), (1, 1, 1), (2, 2, 2), 1)})
    held = SymmetryPlane("block left"), SymmetryPlane("block front")
    pair = ContactPair("block bottom", RigidPlane((0, 0, 0), (0, 0, 1)))
    load = RigidLoad("block top", (0, 0, -0.3), point=(0.5, 0.5, 1.0))
    with pytest.raises(SceneError, match="in directions that symmetry planes"):
        Scene("block", mesh, {"block": STEEL}, held, pair, rigid_loads=replace(load, force=(0.1, 0, 0)))
    scene = Scene("block", mesh, {"block": STEEL}, held, pair, rigid_loads=load)
    step = solve(scene, 0.2, solver=EXACT)
    assert step.record.force == pytest.approx(0.3, rel=1e-7)
    assert [*step.record.motions] == ["block top"] and step.record.motions["block top"][2] < -0.3 / YOUNG * 0.8
    with pytest.raises(SolveError, match="nothing holds body 'block' along z: a load drives"):
        solve(replace(scene, rigid_loads=replace(load, force=(0, 0, 0.3))), 0.2, max_steps=1)
    with pytest.raises(SceneError, match="shares nodes with the surface 'block bottom'"):
        replace(scene, rigid_loads=RigidLoad("block right", (0.1, 0, 0)))


@PARALLEL
def test_through_a_body_that_contact_alone_holds():
    """A rigid load presses a block onto another one that is free along it; pulled, the message says what is wrong."""
    cubes = {name: block((0, 0, z), (1, 1, z + 1), (2, 2, 2), 1) for z, name in enumerate("abc")}
    held = [SymmetryPlane(f"{name} {side}") for name in cubes for side in ("left", "front")]
    scene = Scene(
        "stack",
        root_mesh_from_shapes(cubes),
        dict.fromkeys(cubes, STEEL),
        (Dirichlet("a bottom", z=0.0), *held),
        (ContactPair("b bottom", "a top"), ContactPair("c bottom", "b top")),
        rigid_loads=RigidLoad("c top", (0, 0, -0.3)),
    )
    step = solve(scene, 0.3, solver=EXACT, max_steps=2)
    assert step.record.pair_forces == pytest.approx([0.3, 0.3], rel=1e-7)
    with pytest.raises(SolveError, match="nothing holds body 'c' along z: a load drives"):
        solve(replace(scene, rigid_loads=RigidLoad("c top", (0, 0, 0.3))), 0.3, max_steps=1)


@PARALLEL
def test_rigid_face_without_load():
    """A face of no load stays plane below a shear traction beside it, and bears nothing."""
    load = RigidLoad("bar top")
    step = solve(
        bar(load, STEEL, cells=(2, 2, 4), tractions=Pressure("bar left", 0.01)), 0.3, solver=EXACT, max_steps=2
    )
    assert np.abs(resultant(step, "bar top")[0]).max() < 1e-9
    assert abs(step.record.motions["bar top"][0]) > 1e-3
    assert "rigid load 'bar top': force (0, 0, 0), moved by (0.0" in str(step)


def test_a_load_that_moves_a_body():
    """Nothing stops a bar on a plane of symmetry that a rigid load pushes along it."""
    with pytest.raises(SolveError, match="nothing holds body 'bar' along x"):
        solve(bar(RigidLoad("bar top", (1, 0, 0)), held=SymmetryPlane("bar bottom")), 0.3, max_steps=1)


def test_bad_rigid_loads():
    """Loads that cannot be meant are refused."""
    for make, message in (
        (lambda: RigidLoad("bar top", moment=(1, np.nan, 0)), "moment of the rigid load"),
        (lambda: bar(RigidLoad("bar tip", (1, 0, 0))), "bar top"),
        (lambda: bar(RigidLoad("bar bottom", (1, 0, 0))), "conditions hold its surface"),
        (lambda: bar(RigidLoad("bar top", (1, 0, 0)), held=Dirichlet("bar top", z=0.1)), "both move nodes"),
    ):
        with pytest.raises(SceneError, match=message):
            make()


def test_every_number_of_a_load_counts():
    """A scene with another force, moment or point is another one for a restart."""
    load = RigidLoad("bar top", FORCE, MOMENT)
    others = replace(load, force=MOMENT), replace(load, moment=FORCE), replace(load, point=(0.0, 0.0, 1.0))
    assert all(scene_parts(bar(other)) != scene_parts(bar(load)) for other in others)
    assert scene_parts(bar(replace(load))) == scene_parts(bar(load)) != scene_parts(bar(()))
