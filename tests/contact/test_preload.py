"""Preloaded sections: rods and bolts with exact stiffness."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import everywhere
from model_problems import EXACT

from fx_contact import (
    ContactPair,
    Dirichlet,
    Material,
    Preload,
    RigidPlane,
    Scene,
    SceneError,
    SolveError,
    SymmetryPlane,
    Tie,
    Traction,
    block,
    root_mesh_from_shapes,
    solve,
)
from fx_contact.scene.fingerprint import item_fields

PARALLEL = pytest.mark.ranks(1, 2, 3)
DEGREES = pytest.mark.parametrize("degree", (1, 2))
YOUNG, TENSION = 200.0, 0.3
#: Stress along a line alone.
PLAIN = Material(YOUNG, 0.0)
CUT = Preload("upper bottom", "lower top", axis=(0, 0, -1), tension=TENSION)


def rod(upper=(2, 2, 2), lower=(2, 2, 2), cut=CUT, symmetry=1):
    """A rod of two cubes between walls, cut in the middle."""
    mesh = root_mesh_from_shapes(
        {"lower": block((0, 0, 0), (1, 1, 1), lower, 1), "upper": block((0, 0, 1), (1, 1, 2), upper, 1)}
    )
    sides = tuple(SymmetryPlane(f"{body} {side}") for body in ("lower", "upper") for side in ("left", "front"))
    walls = Dirichlet("lower bottom", z=0.0), Dirichlet("upper top", z=0.0)
    return Scene("rod", mesh, dict.fromkeys(mesh.bodies, PLAIN), (*sides, *walls), ties=cut, symmetry=symmetry)


def forces(step):
    """Forces of the record, by name."""
    return {one.name: np.array(one.force) for one in step.record.resultants}


@PARALLEL
@DEGREES
@pytest.mark.parametrize("upper", [(2, 2, 2), (3, 3, 2)], ids=["alike", "apart"])
@pytest.mark.parametrize("turned", (False, True))
def test_rod_between_walls(upper, turned, degree):
    """The tension F closes the section by 2 F L / (E A); the walls pull with F.  Which side is first does not count."""
    scene = rod(upper, cut=CUT.reversed() if turned else CUT)
    step = solve(scene, 0.1, degree=degree, solver=EXACT)
    assert step.record.motions == {scene.ties[0].name: pytest.approx(2 * TENSION / YOUNG, rel=1e-8)}
    found, down = forces(step), -1 if turned else 1
    assert found[scene.ties[0].name] == pytest.approx((0, 0, down * TENSION), abs=1e-8 * TENSION)
    assert found["upper top"] == pytest.approx((0, 0, TENSION), abs=1e-8 * TENSION)
    known = np.array([0, 0, TENSION, 0, 0, 0])
    everywhere(np.abs(step.nodal_stress - known).max(initial=0) < 1e-6 * TENSION, "stress")
    assert step.record.reached and step.record.estimate < 1e-7
    assert f"closed by {2 * TENSION / YOUNG:.5g}" in str(step)
    held = replace(scene.ties[0], tension=None, closing=step.record.motions[scene.ties[0].first])
    again = solve(replace(scene, ties=held), 0.1, degree=degree, solver=EXACT)
    assert again.record.motions == {}
    assert forces(again)["upper top"] == pytest.approx((0, 0, TENSION), abs=1e-7 * TENSION)


def test_symmetric_parts_share_the_tension():
    """The tension is of all symmetric parts, as the forces in the record."""
    step = solve(rod(symmetry=4), 0.1, solver=EXACT)
    assert step.record.motions[CUT.name] == pytest.approx(2 * TENSION / 4 / YOUNG, rel=1e-8)
    assert forces(step)[CUT.name][2] == pytest.approx(TENSION, rel=1e-8)


def bolted(cut, load=0.0):
    """A bolt (area 1) and a sleeve (area 2), of length 2, side by side below a stiff cap that cannot tilt.

    The cap is glued to the bolt, rests on the sleeve, and is pulled upwards by a load.
    """
    bodies = {
        "shank": block((0, 0, 0), (1, 1, 1), (2, 2, 1), 1),
        "bolt": block((0, 0, 1), (1, 1, 2), (2, 2, 1), 1),
        "sleeve": block((1, 0, 0), (3, 1, 2), (4, 2, 2), 1),
        "left cap": block((0, 0, 2), (1, 1, 3), (2, 2, 1), 1),
        "right cap": block((1, 0, 2), (3, 1, 3), (4, 2, 1), 1),
    }
    mesh = root_mesh_from_shapes(bodies)
    stiff = Material(1e6 * YOUNG, 0.0)
    materials = dict.fromkeys(("shank", "bolt", "sleeve"), PLAIN) | dict.fromkeys(("left cap", "right cap"), stiff)
    upright = tuple(Dirichlet(f"{body} {side}", x=0.0) for body in bodies for side in ("left", "right"))
    upright += tuple(Dirichlet(f"{body} {side}", y=0.0) for body in bodies for side in ("front", "back"))
    ties = cut, Tie("left cap bottom", "bolt top"), Tie("left cap right", "right cap left")
    return Scene(
        "bolted",
        mesh,
        materials,
        (*upright, Dirichlet("shank bottom", z=0.0), Dirichlet("sleeve bottom", z=0.0)),
        ContactPair("sleeve top", "right cap bottom", direction=(0, 0, 1)),
        (Traction("right cap top", (0.0, 0.0, load / 2)),) if load else (),
        ties=ties,
    )


@PARALLEL
@DEGREES
def test_tightening_then_loading(degree):
    """A load P is shared as the stiffnesses k_b = E / 2 of the bolt and k_s = E of the sleeve say, until they part."""
    cut = Preload("bolt bottom", "shank top", axis=(0, 0, -1), tension=TENSION)
    first = solve(bolted(cut), 0.2, degree=degree, solver=EXACT)
    assert first.record.force == pytest.approx(TENSION, rel=1e-6)
    assert [*first.record.motions] == ["bolt bottom bolted to shank top"]
    closing = first.record.motions["bolt bottom"]
    assert closing == pytest.approx(TENSION * (2 / YOUNG + 1 / YOUNG), rel=1e-4)
    held = replace(cut, tension=None, closing=closing)
    for load in (0.1, 0.3):
        step = solve(bolted(held, load), 0.2, degree=degree, solver=EXACT)
        assert -forces(step)[cut.name][2] == pytest.approx(-TENSION - load / 3, rel=1e-4)
        assert step.record.force == pytest.approx(TENSION - 2 * load / 3, rel=1e-4)
    apart = solve(bolted(held, 0.6), 0.2, degree=degree, solver=EXACT)
    assert apart.record.force == 0 and forces(apart)[cut.name][2] == pytest.approx(0.6, rel=1e-4)


@PARALLEL
def test_together_with_a_settling_obstacle():
    """A cut and a plane below a force are unknown together: each has its force."""
    one = rod()
    bodies = {"lower": (0, 0), "upper": (0, 1), "block": (2, 0)}
    shapes = {name: block((x, 0, z), (x + 1, 1, z + 1), (2, 2, 2), 1) for name, (x, z) in bodies.items()}
    mesh = root_mesh_from_shapes(shapes)
    plane = ContactPair("block top", RigidPlane((0, 0, 1.0), (0, 0, -1)), force=(0, 0, -0.1))
    held = SymmetryPlane("block left"), SymmetryPlane("block front"), Dirichlet("block bottom", z=0.0)
    scene = Scene("both", mesh, dict.fromkeys(mesh.bodies, PLAIN), (*one.dirichlet, *held), plane, ties=CUT)
    step = solve(scene, 0.3, solver=EXACT)
    assert forces(step)[CUT.name][2] == pytest.approx(TENSION, rel=1e-8)
    assert step.record.force == pytest.approx(0.1, rel=1e-8)
    known = {"block top on rigid plane": 0.1 / YOUNG, CUT.name: 2 * TENSION / YOUNG}
    assert step.record.motions == pytest.approx(known, rel=1e-7)
    with pytest.raises(KeyError, match="has no motion along a given force; 'block top on rigid plane', "):
        step.record.motions["nothing"]


def test_tightening_in_two_stages():
    """A closing beside a tension changes nothing: the motion is the whole closing."""
    first = solve(rod(), 0.1, solver=EXACT).record.motions[CUT.name]
    more = replace(CUT, tension=2 * TENSION, closing=first)
    second = solve(rod(cut=more), 0.1, solver=EXACT).record.motions[CUT.name]
    assert second == pytest.approx(4 * TENSION / YOUNG, rel=1e-8)


def test_bad_sections():
    """Axes into the first side, oblique ones, and numbers that cannot be meant are refused."""
    with pytest.raises(SceneError, match="out of the first side"):
        rod(cut=replace(CUT, axis=(0, 0, 1)))
    with pytest.raises(SceneError, match="out of the first side"):
        rod(cut=replace(CUT, axis=(0, 0.1, -1)))
    for changes in ({"tension": -1.0}, {"tension": np.nan}, {"closing": "a"}, {"axis": (0, 0, 0)}, {"axis": 1.0}):
        with pytest.raises(SceneError, match="'upper bottom' bolted to"):
            replace(CUT, **changes)
    free = rod()
    cuts = CUT, replace(CUT, tension=0.4), replace(CUT, tension=0.4, closing=0.01)
    one, two, three = (item_fields(free.mesh, cut) for cut in cuts)  # for restarts
    assert one != two != three
    with pytest.raises(SolveError, match="nothing holds body 'upper' along z: a load drives"):
        solve(replace(free, dirichlet=free.dirichlet[:-1]), 0.5, max_steps=1)
