"""Plausible slips: those that would give a wrong result are errors or doubts, calls with one meaning work."""

import inspect
from dataclasses import replace

import numpy as np
import pytest
from test_bad_input import COMM, STEEL, press, shared_folder, two_cubes

from fx_contact import (
    Checkpoint,
    ContactForce,
    ContactPair,
    Dirichlet,
    Displacement,
    Elastic,
    Material,
    Pressure,
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
from fx_contact.plot import draw_convergence, draw_sweep
from fx_contact.verdict.model_warning import check_model_warnings, growing_pressure
from fx_contact.verdict.scene_warnings import warnings_of

pytestmark = pytest.mark.ranks(1, 2)

PAIR = "under on over"
SLAB = block((0, 0, 0), (1, 1, 1), (1, 1, 1), 1)


def planes(*names):
    """Conditions of the two cubes, that on the lower one without what would cross a plane, and symmetry planes."""
    held = Dirichlet("base", z=0.0), Dirichlet("top", z=-0.01)
    return (*held, *(Dirichlet(f"{body} front", y=0.0) for body in ("lower", "upper")), *map(SymmetryPlane, names))


BOTH = "lower left", "upper left"


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
    for closed, cause in ((28, "sharp edge"), (3, "3 closed node pairs on the mesh before do not resolve it")):
        found = growing_pressure("cubes", pressures, [1, 2, closed, 100][-len(pressures) :])
        assert [one.kind for one in found] == ["growing pressure"] * is_growing
        assert all(cause in one.message for one in found)
    assert not growing_pressure("cubes", [0.0, *pressures[1:]][-4:], [50] * 4)


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
