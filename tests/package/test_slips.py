"""Plausible slips: those that would give a wrong result are errors or doubts, calls with one meaning work."""

import inspect
from dataclasses import replace

import numpy as np
import pytest
from conftest import WORLD
from test_bad_input import COMM, STEEL, cubes_apart, from_file, press, shared_folder, two_cubes

import fx_contact
from fx_contact import (
    Checkpoint,
    ContactForce,
    ContactPair,
    Dirichlet,
    Displacement,
    Elastic,
    Gap,
    Material,
    MaxPressure,
    PairingError,
    Pressure,
    Reaction,
    RigidMotion,
    Scene,
    SceneError,
    SymmetryPlane,
    Tie,
    Traction,
    ValidityError,
    adapt,
    block,
    join,
    root_mesh_from_shapes,
    solve,
    sweep,
)
from fx_contact.estimate.goal_errors import GoalRecord
from fx_contact.parallel.errors import GeometryError
from fx_contact.plot import draw_convergence, draw_sweep
from fx_contact.verdict.model_warning import check_model_warnings, growing_pressure
from fx_contact.verdict.scene_warnings import warnings_of

pytestmark = pytest.mark.ranks(1, 2)

PAIR = "under on over"
SLAB = block((0, 0, 0), (1, 1, 1), (1, 1, 1), 1)

#: A square in Gmsh's format.
SQUARE = """$MeshFormat
2.2 0 8
$EndMeshFormat
$Nodes
4
1 0 0 0
2 1 0 0
3 1 1 0
4 0 1 0
$EndNodes
$Elements
1
1 3 2 1 1 1 2 3 4
$EndElements
"""


def planes(*names):
    """Conditions of the two cubes, that on the lower one without what would cross a plane, and symmetry planes."""
    held = Dirichlet("base", z=0.0), Dirichlet("top", z=-0.01)
    return (*held, *(Dirichlet(f"{body} front", y=0.0) for body in ("lower", "upper")), *map(SymmetryPlane, names))


BOTH = "lower left", "upper left"

#: Slips that are errors: call, type of the error, words of its message.
ERRORS = [
    # Names.
    (lambda: press(materials={"lower": STEEL, "uper": STEEL}), SceneError, "did you mean 'upper'?"),
    # Materials.
    (lambda: Material(1e30, 0.3), SceneError, "is that of no material"),
    (lambda: Material(1e-30, 0.3), SceneError, "is that of no material"),
    # Loads that do nothing.
    (
        lambda: press(tractions=Pressure("top", 1.0), dirichlet=held()),
        SceneError,
        "the pressure on 'top' moves nothing",
    ),
    (lambda: press(tractions=(Traction("top", (0, 0, -1.0)),)), SceneError, "the traction on 'top' moves nothing"),
    (lambda: press(tractions=(Traction("upper top", (0, 0, -1.0)),)), SceneError, "'upper top' moves nothing"),
    # Elastic supports and rigid motions.
    (lambda: Elastic("top"), SceneError, "the elastic support on 'top' has no stiffness: give normal, or some of x"),
    (
        lambda: Elastic("top", 0.0),
        SceneError,
        "the stiffness normal of the elastic support on 'top' must be a positive",
    ),
    (lambda: Elastic("top", x=1.0, z=-1.0), SceneError, "must be a positive number, got -1.0"),
    (lambda: Elastic("top", y=np.inf), SceneError, "must be a positive number, got inf"),
    (lambda: Elastic("top", (1.0, 1.0, 1.0)), SceneError, "must be a positive number, got (1.0, 1.0, 1.0)"),
    (lambda: Elastic(3, 1.0), SceneError, "the surface of an elastic support must be a name, got 3"),
    (lambda: press(springs=Elastic("tpo", 1.0)), SceneError, "did you mean 'top'?"),
    (lambda: press(springs=Dirichlet("top", 0.0)), SceneError, "springs must be a tuple of Elastic"),
    (lambda: press(dirichlet=(*held(), Elastic("top", 1.0))), SceneError, "dirichlet must be a tuple of Dirichlet"),
    (lambda: press(springs=Elastic("top", 1.0)), SceneError, "the elastic support on 'top' moves nothing"),
    (lambda: press(springs=Elastic("under", 1e30)), SceneError, "times as stiff as its body"),
    (lambda: press(springs=Elastic("upper left", y=1e-15)), SceneError, "times as soft as its body"),
    (lambda: RigidMotion("top", 0.01), SceneError, "the translation of the rigid motion of 'top' must have three"),
    (lambda: RigidMotion("top", rotation=(0, 0, np.nan)), SceneError, "must be a finite number, got nan"),
    (lambda: RigidMotion(3), SceneError, "the place of a displacement condition must be a name, got 3"),
    (
        lambda: press(RigidMotion("base", rotation=(0, 0, 0.1))),
        SceneError,
        "on 'base' is prescribed as 0.1 where another",
    ),
    # Functions of position are tried.
    (lambda: press(tractions=(Pressure("upper left", lambda x: x),)), SceneError, "must give an array of shape"),
    (lambda: press(tractions=(Pressure("upper left", lambda x: 1 / (0 * x[0])),)), SceneError, "must be finite"),
    (lambda: press(body_forces=fx_contact.BodyForce("upper", lambda x: x[0])), SceneError, "of shape (3, 216)"),
    # Symmetry.
    (lambda: press(symmetry=2), SceneError, "planes without normal displacement make 1 copies"),
    (lambda: press(symmetry=3), SceneError, "symmetry=3, but"),
    (lambda: press(dirichlet=planes(*BOTH), symmetry=3), SceneError, "symmetry=3, but"),
    (lambda: press(dirichlet=planes(*BOTH), symmetry=16), SceneError, "make 8 copies"),
    (lambda: beside(), SceneError, "bodies are on both sides of the symmetry plane with the normal [1. 0. 0.]"),
    # Surfaces that look the same way.
    (lambda: press(contact=(ContactPair("lower top", "upper top"),)), PairingError, "look the same way"),
    (lambda: press(contact=(ContactPair("lower bottom", "upper bottom"),)), PairingError, "look the same way"),
    (
        lambda: press(contact=(ContactPair("under", "top"),), mesh=cubes_apart()),
        PairingError,
        "do not face each other",
    ),
    (lambda: press(contact=ContactPair("under", "over", clearance=10.0)), SceneError, "is more than the size of all"),
    # Goals.
    (lambda: ContactForce(PAIR, 1.0), SceneError, "relative and must be below 1, got 1.0: 4 % are 0.04"),
    (lambda: MaxPressure(PAIR, 5), SceneError, "must be below 1, got 5"),
    (lambda: Displacement((0, 0, 1), (0, 0, 1), 100), SceneError, "must be below 1"),
    (lambda: Reaction("top", 1e-12), SceneError, "at least 1e-09"),
    (lambda: adapt(press(), 0.5, COMM, goals=Gap(PAIR, (10, 0, 0), 0.1)), SceneError, "is 9.06 away from the nodes"),
    (lambda: adapt(press(), 0.5, COMM, goals="force"), SceneError, "goals must be a tuple of ContactForce"),
    # Steps and points.
    (lambda: adapt(press(), 0.5, COMM)[-1], SceneError, "solve(...) or `last_step()` gives the last one"),
    (lambda: sweep(lambda t: press(), [1.0], 0.5, COMM)[0], SceneError, "`records` has the figures of all"),
    # Meshes.
    (lambda: from_file(SQUARE), GeometryError, "the mesh has no volumes, and surfaces of ['Quadrilateral 4']"),
    (lambda: join([SLAB, 3]), SceneError, "what is joined must be a tuple of Shape"),
    (lambda: joined(3.0), GeometryError, "nodes in common, but no face of a cell"),
    (lambda: joined(20 / 3), GeometryError, "without being one of its nodes"),
    # No checkpoint in the folder.
    (lambda: adapt(press(), 0.5, COMM, restart="no/such"), fx_contact.CheckpointError, "No such file"),
]


def held():
    """The two cubes, clamped below and on top."""
    return Dirichlet("base", 0.0, 0.0, 0.0), Dirichlet("top", 0.0, 0.0, 0.0)


def beside():
    """Two cubes side by side, of which one has a plane of symmetry where the other one begins."""
    cube = block((0, 0, 0), (1, 1, 1), (1, 1, 1), 1)
    mesh = root_mesh_from_shapes({"lower": cube, "upper": cube.shifted(x=-1)})
    conditions = (
        Dirichlet("lower bottom", y=0.0, z=0.0),
        Dirichlet("upper bottom", 0, 0, 0),
        SymmetryPlane("lower left"),
    )
    return Scene("beside", mesh, {"lower": STEEL, "upper": STEEL}, conditions, symmetry=2)


def joined(height):
    """Two blocks side by side, of height 10 in three cells and of another height in one."""
    high, low = (block((0, 0, 0), (1, 1, z), (1, 1, n), 1) for z, n in ((10.0, 3), (height, 1)))
    return root_mesh_from_shapes({"both": join(high, low.shifted(x=1))})


@pytest.mark.parametrize("action, kind, words", [pytest.param(*case, id=case[2]) for case in ERRORS])
def test_slips_that_are_errors(action, kind, words):
    """The same on all ranks, with what is right."""
    with pytest.raises(kind) as caught:
        action()
    told = WORLD.allgather(str(caught.value))
    assert words in told[0] and len(set(told)) == 1, told


def warned(scene):
    """Kinds of the warnings of a scene, and their places."""
    return [(warning.kind, warning.place) for warning in warnings_of(scene)]


def test_slips_that_are_doubts():
    """A load of which a part is held, and a body left free on a plane of symmetry."""
    assert not warned(press())
    aslant = Traction("top", (3e-3, 0.0, -4e-3))
    sliding = Dirichlet("base", 0.0, 0.0, 0.0), Dirichlet("top", y=0.0, z=-0.01), Dirichlet("upper left", x=0.0)
    found = warnings_of(press(dirichlet=sliding, tractions=aslant))
    assert [(one.kind, one.place) for one in found] == [("held load", "top")] and abs(found[0].value - 0.8) < 1e-12
    scene = press(dirichlet=planes("lower left"), symmetry=2, contact=(), ties=Tie("under", "over"))
    assert warned(scene) == [("free on a plane", "upper")]
    assert "held load" in [one.kind for one in solve(press(dirichlet=sliding, tractions=aslant), 0.5).record.doubts]
    assert not warned(replace(scene, dirichlet=planes(*BOTH)))


def test_slips_of_supports_that_are_doubts():
    """Springs of which a part is on held displacements, rotations that are not small; those from 0.5 on are refused."""
    (found,) = warnings_of(press(springs=Elastic("upper left", normal=1.0, y=3.0), dirichlet=planes(*BOTH)))
    assert (found.kind, found.place) == ("held load", "upper left") and abs(found.value - 0.25) < 1e-12
    assert not warned(press(springs=Elastic("top", x=1.0), dirichlet=planes(*BOTH)))

    def turned(angle):
        """The upper cube, turned on top."""
        return press(dirichlet=(held()[0], RigidMotion("top", (0, 0, -0.01), (0, 0, angle), (0.5, 0.5, 2.0))))

    assert not warned(turned(0.05)) and warned(turned(-0.06)) == [("large rotation", "top")]
    with pytest.raises(ValidityError, match="rotation by 34 degrees prescribed on 'top'.* lengthens lines .* by 18%"):
        check_model_warnings(warnings_of(turned(-0.6)), allow=())


@pytest.mark.parametrize("count, symmetry", [(0, 2), (1, 2), (1, 4), (2, 2), (2, 4)])
def test_copies_that_planes_make(count, symmetry):
    """A zero displacement along the normal alone of a plane surface makes copies as a SymmetryPlane does."""
    cube = block((0, 0, 0), (1, 1, 1), (1, 1, 1), 1)
    sides = {"x": "cube left", "y": "cube front"}
    conditions = [
        SymmetryPlane(s) if i < count else Dirichlet(s, **{c: 0.0}) for i, (c, s) in enumerate(sides.items())
    ]
    conditions += [Dirichlet("cube bottom", z=-0.1)]
    mesh = root_mesh_from_shapes({"cube": cube})

    def make():
        return Scene("cube", mesh, {"cube": STEEL}, tuple(conditions), symmetry=symmetry)

    if symmetry == 2 and count == 2:
        with pytest.raises(SceneError, match="make more than 2 copies"):
            make()
    else:
        assert make().mirrors.parts == (2**count if 2**count == symmetry else 1)


def test_known_goals():
    """The force of two cubes below a pressure is fixed by equilibrium, which is said instead of an error."""
    scene = press(
        dirichlet=(Dirichlet("base", 0.0, 0.0, 0.0), *(Dirichlet(f"upper {s}", **{c: 0.0}) for s, c in SIDES)),
        tractions=Pressure("top", 0.01),
    )
    force, end = ContactForce(PAIR, 0.1), Displacement((0.5, 0.5, 2.0), (0, 0, 1), 0.5)
    record = solve(scene, 0.5, goals=(force, end)).record
    assert [goal.known for goal in record.goals] == [True, False]
    assert "fixed by equilibrium" in str(record.goals[0]) and "estimated error" in str(record.goals[1])
    assert not GoalRecord("open", 0.0, None, 0.0, 0.1, True).known


SIDES = (("left", "x"), ("front", "y"))


@pytest.mark.parametrize("pressures, is_growing", [([1, 2, 3, 4], True), ([1, 2, 3, 3.1], False), ([1, 2, 3], False)])
def test_growing_pressure(pressures, is_growing):
    """More than 5 % on each of three refinements; not before contact."""
    found = growing_pressure("cubes", pressures)
    assert [one.kind for one in found] == ["growing pressure"] * is_growing
    assert not growing_pressure("cubes", [0.0, *pressures[1:]][-4:])


def test_one_object_for_a_tuple():
    """Alike for conditions, loads, contacts, ties, goals and kinds of warnings."""
    load, pair, goal = Pressure("upper left", 0.0), ContactPair("under", "over", (0, 0, 1)), ContactForce(PAIR, 0.5)
    scene = press(tractions=load, contact=pair)
    assert scene.tractions == (load,) and scene.contact == (pair,)
    assert press(contact=(), ties=Tie("under", "over")).ties == (Tie("under", "over"),)
    run = adapt(scene, 0.5, COMM, goals=goal, allow="large strain")
    assert run.settings.goals == (goal,) and run.settings.allow == ("large strain",)
    assert len(join([SLAB, SLAB.shifted(z=1)]).cells) == 2


def test_restart_from_a_folder():
    """As from its Checkpoint; if one rank names a folder, and others do not, all are told."""
    with shared_folder() as folder:
        step = solve(press(), 0.5, COMM, max_steps=1, checkpoint=folder)
        for restart in (folder, str(folder), Checkpoint(folder, press(), COMM)):
            again = solve(press(), 0.5, COMM, max_steps=1, restart=restart)
            assert again.record.force == pytest.approx(step.record.force, rel=1e-9)


def test_attributes_of_the_record():
    """A figure that is in the record is named there; other names are Python's."""
    step = solve(press(), 0.5, COMM, max_steps=1)
    with pytest.raises(AttributeError, match="did you mean `step.record.force`?"):
        step.force
    with pytest.raises(AttributeError, match="a Step has no attribute 'nothing'"):
        step.nothing
    assert not hasattr(step, "_repr_html_")


def test_runs_and_sweeps_are_drawn(tmp_path):
    """A Run and a Sweep stand for their records."""
    pytest.importorskip("matplotlib")
    path = COMM.bcast(tmp_path)
    points = sweep(
        lambda down: press(dirichlet=(held()[0], Dirichlet("top", 0.0, 0.0, -down))), [0.01, 0.02], 0.5, COMM
    )
    assert len(list(points)) == 2 and draw_sweep(points, path / "sweep.png", COMM).exists()
    run = adapt(press(), 0.5, COMM)
    run.last_step()
    assert draw_convergence(run, path / "run.png", COMM).exists()


def test_given_names_are_added():
    """The sides of the bodies keep their names beside the given ones; a given name replaces a side of the same name."""
    mesh = two_cubes()
    assert np.array_equal(mesh.surfaces["base"], mesh.surfaces["lower bottom"]) and "upper left" in mesh.surfaces
    mesh = root_mesh_from_shapes({"a": SLAB}, {"a top": "a bottom"})
    assert np.array_equal(mesh.surfaces["a top"], mesh.surfaces["a bottom"])


def test_solve_has_the_arguments_of_adapt():
    """With the same defaults."""
    ours, theirs = (inspect.signature(one).parameters for one in (solve, adapt))
    assert [str(one) for one in ours.values()] == [str(one) for one in theirs.values()]


def test_angles_of_rounding():
    """Are no zero in radians."""
    assert np.allclose(SLAB.turned("z", 0.1 * 3 - 0.3).points, SLAB.points)


def test_stiff_and_soft_are_materials():
    """From a gel in GPa to diamond in dyn/cm^2."""
    assert Material(1e-9, 0.3).young == 1e-9 and Material(1.2e13, 0.1).young == 1.2e13
