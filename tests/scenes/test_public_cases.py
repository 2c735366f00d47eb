"""Cases from public threads, with right values by statics and known solutions; none has a warning."""

import numpy as np
import pytest

from fx_contact import (
    ContactPair,
    Dirichlet,
    Material,
    Preload,
    Pressure,
    RigidCone,
    RigidPlane,
    Scene,
    SymmetryPlane,
    ThermalStrain,
    Tie,
    ball,
    block,
    cylinder,
    ring,
    root_mesh_from_shapes,
    solve,
)
from studies.cost.chains import chain

pytestmark = pytest.mark.ranks(1, 2, 3)


def pressed(name, shapes, materials, held, contacts, loads, tolerance=0.1, ties=(), symmetry=1, **options):
    """The record of a scene by shapes."""
    mesh = root_mesh_from_shapes(shapes)
    if isinstance(materials, Material):
        materials = dict.fromkeys(shapes, materials)
    scene = Scene(name, mesh, materials, held, contacts, loads, ties=ties, symmetry=symmetry)
    record = solve(scene, tolerance, **options).record
    assert not record.doubts, record.doubts
    return record


def test_blocks_whose_contacts_cross_in_a_line():
    """code_aster, V6.04.511: four blocks of unlike moduli, meshed apart, under unlike pressures."""
    places = {"ll": (0, 0, 2, 1.0), "lr": (1, 0, 3, 10.0), "ul": (0, 1, 4, 100.0), "ur": (1, 1, 5, 1.0)}
    shapes = {
        name: block((x, y, 0), (x + 1, y + 1, 0.5), (cells, cells, 1), 1) for name, (x, y, cells, _) in places.items()
    }
    held = [SymmetryPlane(f"{name} left") for name in ("ll", "ul")] + [
        SymmetryPlane(f"{n} front") for n in ("ll", "lr")
    ]
    held += [SymmetryPlane(f"{name} {side}") for name in places for side in ("bottom", "top")]
    pairs = [("ll right", "lr left"), ("ul right", "ur left"), ("ll back", "ul front"), ("lr back", "ur front")]
    loads = {"lr right": 1e-3, "ur right": 2e-3, "ul back": 3e-3, "ur back": 1e-3}
    record = pressed(
        "cross",
        shapes,
        {name: Material(young, 0.3) for name, (*_, young) in places.items()},
        tuple(held),
        tuple(ContactPair(*pair) for pair in pairs),
        tuple(Pressure(*load) for load in loads.items()),
        max_steps=2,
    )
    assert record.pair_forces == pytest.approx([5e-4, 1e-3, 1.5e-3, 5e-4], rel=1e-6)


@pytest.mark.parametrize("cells", [(2, 2, 4), (3, 2, 4)], ids=["alike", "apart"])
def test_a_lid_across_a_joint(cells):
    """Its bottom is in contact with two blocks, which stand side by side on a plane and may part."""
    shapes = {
        "lid": block((0, 0, 1), (2, 1, 2), (2 * cells[0], cells[0], 2), 1),
        "left": block((0, 0, 0), (1, 1, 1), (2, 2, 2), 1),
        "right": block((1, 0, 0), (2, 1, 1), (2, 2, 2), 1),
    }
    record = pressed(
        "lid",
        shapes,
        Material(1.0, 0.0),
        (Dirichlet("left bottom", z=0.0), Dirichlet("right bottom", z=0.0)),
        (ContactPair("lid bottom", ("left top", "right top")), ContactPair("left right", "right left")),
        (Pressure("lid top", 1e-3),),
        max_steps=2,
    )
    assert record.pair_forces == pytest.approx([2e-3, 0.0], rel=1e-6, abs=1e-9)
    assert set(record.free_motions) == {"lid", "left", "right"}


def rings(heat):
    """Forces of the two interfaces of three rings, an eighth: interference 0.01, play 0.02, then heat."""
    radii, moduli, ratios, alpha = (20, 30, 40, 50), (210e3, 70e3, 210e3), (0.3, 0.33, 0.3), (12e-6, 23e-6, 12e-6)
    names = "inner", "middle", "outer"
    shapes = {name: ring(a, b, 5, (2, 4, 1), quarters=1) for name, a, b in zip(names, radii, radii[1:])}
    scene = Scene(
        "rings",
        root_mesh_from_shapes(shapes),
        {name: Material(young, ratio) for name, young, ratio in zip(names, moduli, ratios)},
        tuple(SymmetryPlane(f"{name} {side}") for name in names for side in ("x = 0", "y = 0", "bottom")),
        (
            ContactPair("inner outside", "middle inside", clearance=-0.01),
            ContactPair("middle outside", "outer inside", clearance=0.02),
        ),
        strains=tuple(ThermalStrain(name, a, heat) for name, a in zip(names, alpha)) if heat else (),
        symmetry=8,
    )
    return np.array(solve(scene, 0.03).record.pair_forces) / (2 * np.pi * np.array([30, 40]) * 10)


@pytest.mark.parametrize(
    "heat, expected", [(0, (4.99847, 0)), (40, (0, 0)), (50, (0, 0.720172)), (200, (0, 24.4859))]
)
def test_rings_pressed_and_heated(heat, expected):
    """CalculiX #98: pressures by Lame's formulas; at 40 K the middle ring is free."""
    assert rings(heat) == pytest.approx(expected, rel=0.005, abs=0.01)


@pytest.mark.parametrize("count", [3, 5])
def test_a_chain_of_thin_rings(count):
    """Each interface of a stack of rings of 1 by 7, meshed apart, bears the load."""
    record = solve(chain(count), 0.1, max_steps=2).record
    assert not record.doubts, record.doubts
    assert record.pair_forces == pytest.approx([1000.0] * (count - 1), rel=0.02)
    assert np.ptp(record.pair_forces) < 1e-3


def test_a_soft_pad():
    """Of Poisson's ratio 0.4999 between stiff plates, meshed apart: without friction the first mesh is exact."""
    heights = {"lower": (0, 0.5), "pad": (0.5, 0.7), "upper": (0.7, 1.2)}
    shapes = {
        name: block((0, 0, low), (1, 1, high), (*2 * (2 + (name == "pad"),), 1), 1)
        for name, (low, high) in heights.items()
    }
    held = [SymmetryPlane(f"{name} {side}") for name in shapes for side in ("left", "front")]
    record = pressed(
        "pad",
        shapes,
        {"lower": Material(1e3, 0.0), "pad": Material(1.0, 0.4999), "upper": Material(1e3, 0.0)},
        (Dirichlet("lower bottom", z=0.0), Dirichlet("upper top", z=-0.002), *held),
        (ContactPair("pad bottom", "lower top"), ContactPair("upper bottom", "pad top")),
        (),
        max_steps=1,
    )
    # the pad spreads beyond the plates by nu times its strain on two of its sides
    assert record.pair_forces == pytest.approx([0.002 / (0.2 + 1e-3)] * 2, rel=1e-3)


def rods(rod, tube, pull=0.0):
    """Forces in rod, tube and sleeve, a quarter below a pulled cap, and closings of the cuts that have a tension."""
    half_rod, half_tube = cylinder(4, 50, (1, 1), quarters=1), ring(20, 22, 50, (1, 2, 1), quarters=1)
    shapes = {"rod": half_rod, "tube": half_tube, "sleeve": ring(8, 14, 100, (1, 2, 1), quarters=1)}
    shapes |= {"upper rod": half_rod.shifted(z=50), "upper tube": half_tube.shifted(z=50)}
    shapes["cap"] = cylinder(24, 20, (2, 1), quarters=1).shifted(z=100)
    tightened = {"rod": rod, "tube": tube}
    cuts = [Preload(f"upper {name} bottom", f"{name} top", (0, 0, -1), **cut) for name, cut in tightened.items()]
    held = [SymmetryPlane(f"{name} {side}") for name in shapes for side in ("x = 0", "y = 0")]
    record = pressed(
        "rods",
        shapes,
        {name: Material({"cap": 7e9, "sleeve": 70e3}.get(name, 210e3), 0.0) for name in shapes},
        (*held, *(Dirichlet(f"{name} bottom", z=0.0) for name in ("rod", "tube", "sleeve"))),
        ContactPair("sleeve top", "cap bottom"),
        Pressure("cap top", -pull / (np.pi * 24**2)) if pull else (),
        ties=(*cuts, Tie("cap bottom", "upper rod top"), Tie("cap bottom", "upper tube top")),
        symmetry=4,
        max_steps=1,
    )
    found = {one.name: one.force[2] for one in record.resultants}
    return [*(found[cut.name] for cut in cuts), record.force], [*record.motions.values()]


def test_rods_tightened_in_sequence():
    """CalculiX #147, to 0.3 %: a rod is tightened, keeps its length while a tube is, and the cap is pulled; springs."""
    areas = np.pi * np.array([4**2, 22**2 - 20**2, 14**2 - 8**2])
    springs = rod, tube, sleeve = np.array([210e3, 210e3, 70e3]) * areas / 100
    forces, (first, _) = rods({"tension": 20e3}, {"tension": 0.0})
    assert forces == pytest.approx([20e3, 0, 20e3], rel=0.003, abs=1e-3)
    assert first == pytest.approx(20e3 * (1 / rod + 1 / sleeve), rel=0.003)
    forces, (second,) = rods({"closing": first}, {"tension": 10e3})
    clamp = 20e3 + 10e3 * sleeve / (rod + sleeve)
    expected = np.array([clamp - 10e3, 10e3, clamp])
    assert forces == pytest.approx(expected, rel=0.003)
    assert second == pytest.approx(10e3 / tube + clamp / sleeve, rel=0.003)
    forces, _ = rods({"closing": first}, {"closing": second}, pull=8e3)
    assert forces == pytest.approx(expected + 8e3 * springs * [1, 1, -1] / springs.sum(), rel=0.003)


@pytest.mark.parametrize("load", [30, 100])
def test_a_ball_in_a_conical_seat(load):
    """Half a ball in a seat of 45 degrees: normal forces by statics, and those across a quarter's planes of a ring."""
    radius = 10
    record = pressed(
        "ball",
        {"ball": ball(radius, 3, 4, octants=1).mirrored("z")},
        {"ball": Material(1e3, 0.3)},
        (SymmetryPlane("ball x = 0"), SymmetryPlane("ball y = 0")),
        ContactPair("ball outside", RigidCone((0, 0, -np.sqrt(2) * radius), (0, 0, -1), 135)),
        Pressure("ball z = 0", load / (np.pi * radius**2)),
        symmetry=4,
        degree=2,
        max_steps=2,
    )
    assert record.pair_forces == pytest.approx([np.sqrt(2) * load], rel=1e-4)
    planes = [one.force[axis] for one in record.resultants if one.kind == "symmetry" for axis in range(2)]
    assert planes == pytest.approx(np.array([1, 0, 0, 1]) * load / (2 * np.pi), rel=0.01, abs=1e-6)


@pytest.mark.parametrize("stop", ["block", "plane"])
@pytest.mark.parametrize("drawn", [0.48, 0.0])
def test_a_cantilever_above_a_stop(drawn, stop):
    """Pressed to a stop at its tip, with the clearance of 0.48 drawn or given: force by beam theory, to 0.3 %."""
    length, clearance, young, pressure = 20, 0.48, 1e3, 0.005
    shapes, held = {"beam": block((0, 0, 0), (length, 1, 1), (10, 1, 2), 1)}, [Dirichlet("beam left", 0.0, 0.0, 0.0)]
    if stop == "block":
        shapes["stop"] = block((length - 1, 0, -drawn - 1), (length + 1, 1, -drawn), (2, 1, 1), 1)
        held.append(Dirichlet("stop bottom", 0.0, 0.0, 0.0))
    below = "stop top" if stop == "block" else RigidPlane((0, 0, -drawn), (0, 0, 1))
    record = pressed(
        "cantilever",
        shapes,
        Material(young, 0.0),
        held,
        ContactPair("beam bottom", below, clearance=clearance - drawn),
        Pressure("beam top", pressure),
        degree=2,
        max_steps=2,
    )
    tip = length**3 / (3 * young / 12)  # deflection by a unit force
    assert record.pair_forces == pytest.approx([3 / 8 * pressure * length - clearance / tip], rel=0.003)
