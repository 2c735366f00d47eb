"""Violated assumptions of the model: each kind in a scene that has it, and not in one just below the limit."""

import json
from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from conftest import WORLD
from model_problems import step_record
from mpi4py import MPI

from fx_contact import (
    BodyForce,
    ContactPair,
    Dirichlet,
    Material,
    MaxPressure,
    Pressure,
    RigidPlane,
    Scene,
    StepRecord,
    Tie,
    Traction,
    ValidityError,
    adapt,
    root_mesh_from_shapes,
    solve,
)
from fx_contact.fem.cell_strain import cell_strains
from fx_contact.geometry.solids import block as brick
from fx_contact.results.report import model_warnings
from fx_contact.scenes import hertz, indentation, punch, shrink_fit, stack
from fx_contact.verdict.model_warning import ModelWarning
from fx_contact.verdict.solution_warnings import _place_of_largest, load_warnings

#: Without lateral strain, so that strains are known.
MATERIAL = Material(young=1.0, poisson=0.0)


def block(*loads):
    """One block that nothing touches, held on a face."""
    shape = brick((0, 0, 0), (3, 1, 1), (3, 2, 2), 1)
    mesh = root_mesh_from_shapes({"block": shape}, {"bottom": "block bottom", "top": "block top"})
    held = Dirichlet("bottom", 0.0, 0.0, 0.0)
    volume = tuple(one for one in loads if isinstance(one, BodyForce))
    surface = tuple(one for one in loads if one not in volume)
    return Scene("block", mesh, {"block": MATERIAL}, (held,), tractions=surface, body_forces=volume)


def on_a_block(x=0.0, down=0.01, gap=0.0, thick=20.0, bulge=0.0):
    """A block on another one, both 20 wide, moved along their faces and pressed down; its foot may be round."""

    def place(x):
        """The foot is lower by the bulge half way between the corners of its facets."""
        lower = bulge * (np.sin(np.pi * x[0] / 10) * np.sin(np.pi * x[1] / 10)) ** 2 * (1 - x[2] / thick)
        return x[0], x[1], x[2] - lower

    base = brick((0, 0, -20), (20, 20, 0), (2, 2, 1), 2)
    slider = brick((0, 0, gap), (20, 20, thick + gap), (2, 2, 1), 2).placed(place)
    surfaces = {"bottom": "base bottom", "ground": "base top", "foot": "slider bottom", "top": "slider top"}
    held = Dirichlet("bottom", 0.0, 0.0, 0.0), Dirichlet("top", x, 0.0, -down)
    materials = dict.fromkeys(("base", "slider"), MATERIAL)
    mesh = root_mesh_from_shapes({"base": base, "slider": slider}, surfaces)
    return Scene("on a block", mesh, materials, held, (ContactPair("ground", "foot", (0, 0, 1)),))


def warned(scene, **options):
    """Warnings of a single solve, by kind; the same on all ranks, and lines of them in the record."""
    record = solve(scene, 0.5, **{"degree": 1, "max_steps": 1} | options).record
    assert WORLD.allgather(record.doubts).count(record.doubts) == WORLD.size, "ranks differ"
    lines = model_warnings(record)
    assert [line.partition(":")[0] for line in lines] == [warning.kind for warning in record.doubts]
    assert not any("\n" in line for line in lines)
    return {warning.kind: warning for warning in record.doubts}


def test_large_strain():
    """Without lateral strain a pressure p makes the strain p / E everywhere: 6 % is large, 4 % is not."""
    assert not warned(block(Pressure("top", 0.04)))
    found = warned(block(Pressure("top", 0.06)))
    assert [*found] == ["large strain"]
    warning = found["large strain"]
    assert abs(warning.value - 0.06) < 1e-9 and warning.limit == 0.05 and warning.place == "block"
    assert "strain of 0.06" in warning.message


def test_strains_do_not_depend_on_the_mesh():
    """At the edge of a punch they grow without bound, but their mean over the energy does not."""
    means, largest = [], []
    for step in adapt(indentation(displacement=0.1, coarse=2), 0.1, degree=1):
        means.append({warning.kind: warning.value for warning in step.record.doubts}["large strain"])
        strain, _, volume = cell_strains(step.displacement)
        largest.append(WORLD.allreduce(strain.max(initial=0.0), op=MPI.MAX))
        assert abs(WORLD.allreduce(float(volume.sum())) - (1.5 * 1.5 + 0.5 * 0.5)) < 1e-12
    assert largest[-1] > 3 * largest[0] and largest[-1] > 1.3 * largest[-2], largest
    assert means[-1] < 1.05 * means[-2] and means[-1] < 1.5 * means[0], means


@pytest.mark.parametrize("scene", [block(Pressure("top", 0.51)), block(Traction("top", (0.0, 0.0, 30.0)))])
def test_far_too_large_strain(scene):
    """From 50 % on it is an error, unless that is allowed."""
    with pytest.raises(ValidityError, match="'block' has a strain of .*allow="):
        solve(scene, 0.5, degree=1, max_steps=1)
    assert [*warned(scene, allow=("large strain",))] == ["large strain"]
    assert "large strain" in warned(block(Pressure("top", 0.49)))


def turned(degrees):
    """A block with a rotation prescribed on two faces, as linear elasticity has it: without strain."""
    rate = np.radians(degrees)
    turn = {"x": lambda x: -rate * x[1], "y": lambda x: rate * x[0], "z": 0.0}
    mesh = root_mesh_from_shapes({"block": brick((0, 0, 0), (1, 1, 1), (2, 2, 2), 1)})
    held = tuple(Dirichlet(f"block {end}", **turn) for end in ("bottom", "top"))
    return Scene("turned", mesh, {"block": MATERIAL}, held)


def test_large_rotation():
    """2.8 degrees are no warning, 3 are one, and 29 an error."""
    assert not warned(turned(2.8))
    found = warned(turned(3.0))
    assert [*found] == ["large rotation"] and abs(found["large rotation"].value / np.radians(3.0) - 1) < 1e-9
    assert "3 degrees" in found["large rotation"].message
    with pytest.raises(ValidityError, match="turns by 29 degrees"):
        solve(turned(29.0), 0.5, degree=1, max_steps=1)
    assert [*warned(turned(29.0), allow=["large rotation"])] == ["large rotation"]


def test_sliding():
    """A tenth of the radius of the contact, that of the circle of its area: 1.128 on a face of 20 x 20."""
    assert not warned(on_a_block(x=1.0))
    found = warned(on_a_block(x=1.2))
    assert [*found] == ["sliding"]
    warning = found["sliding"]
    assert abs(warning.value - 1.2) < 1e-6 and abs(warning.limit - 2 / np.sqrt(np.pi)) < 1e-9
    assert "sliding" in warned(on_a_block(x=15.0)), "the strain is small, and the force that of the block unmoved"


def test_pressed_from_afar_along_the_normal():
    """The way of a body towards the other one is no sliding, though it is not along the normals of a round body."""
    assert not warned(on_a_block(down=5.01, gap=5.0))
    assert not warned(punch(displacement=1.02, gap=1.0, order=6, coarse=2))


def test_sliding_around_an_axis():
    """A ring that turns inside another one slides along a curve: before that is much, it is a large rotation."""
    scene = shrink_fit(coarse=2, height=4.0)
    turn = {"x": lambda x: -0.13 * x[1], "y": lambda x: 0.13 * x[0], "z": 0.0}
    held = Dirichlet("bore", **turn), Dirichlet("rim", 0.0, 0.0, 0.0)
    found = warned(Scene("turning", scene.mesh, scene.materials, held, scene.contact))
    assert 0.05 < found["large rotation"].value < 0.13 and "sliding" not in found


def test_no_contact():
    """Blocks that end 0.25 apart; touching is contact."""
    warning = warned(on_a_block(down=0.25, gap=0.5))["no contact"]
    assert abs(warning.value - 0.25) < 1e-9 and warning.place == (0.0, 0.0, 0.0)
    assert "the smallest distance of points that face each other is 0.25 in units of the mesh" in warning.message
    in_mm = replace(on_a_block(down=0.25, gap=0.5), units=("mm", "MPa"))
    assert "face each other is 0.25 mm, at" in warned(in_mm)["no contact"].message
    assert not warned(on_a_block(down=0.51, gap=0.5))
    warning = warned(punch(displacement=1.0, gap=10.0, coarse=2))["no contact"]
    assert abs(warning.value - 9.0) < 1e-9 and warning.place == (0.0, 0.0, 0.0), "at the pole, not across the rim"


def test_initial_overlap():
    """5 % of the thinner body; a shrink fit overlaps on purpose, by less."""
    found = warned(on_a_block(down=0.0, gap=-0.6, thick=10.0))["initial overlap"]
    assert abs(found.value - 0.6) < 1e-9 and abs(found.limit - 0.5) < 1e-9 and "of 'slider'" in found.message
    assert not warned(on_a_block(down=0.0, gap=-0.4, thick=10.0))
    assert not warned(shrink_fit(coarse=2))


def test_obstacle_that_touches_and_is_moved():
    """By 6 % of the body it strains it, but does not overlap it before; one drawn inside of it does."""
    scene = replace(block(), contact=ContactPair("top", RigidPlane((0, 0, 1), (0, 0, -1)), moved=(0.0, 0.0, -0.06)))
    assert [*warned(scene)] == ["large strain"]
    scene = replace(scene, contact=ContactPair("top", RigidPlane((0, 0, 0.94), (0, 0, -1)), moved=(0.0, 0.0, 0.02)))
    assert abs(warned(scene)["initial overlap"].value - 0.06) < 1e-9


def lying(upper, lower, named=(), glued=False):
    """A block on another one, by their ends along x and cells; of one of the touching sides only a part is named."""
    shapes = {
        name: brick((low, 0, z), (high, 1, z + 1), (n, max(n // round(high - low), 1) + 1, 1), 1)
        for z, (name, (low, high, n)) in enumerate({"lower": lower, "upper": upper}.items())
    }
    names = {"lower": "lower top", "upper": "upper bottom"}
    if named:
        body, low, high = named
        side, names[body] = names[body].split()[1], f"{body} part"
        within = lambda x: (x[0] > low - 0.01) & (x[0] < high + 0.01)  # noqa: E731
        shapes[body] = shapes[body].named("part", side, where=within)
    surfaces = names["upper"], names["lower"]
    return Scene(
        "lying",
        root_mesh_from_shapes(shapes),
        dict.fromkeys(shapes, Material(1.0, 0.3)),
        (Dirichlet("lower bottom", 0.0, 0.0, 0.0), Dirichlet("upper top", 0.0, 0.0, -0.01)),
        () if glued else (ContactPair(*surfaces),),
        ties=(Tie(*surfaces),) if glued else (),
    )


@pytest.mark.ranks(1, 2, 3)
@pytest.mark.parametrize("degree", [1, 2])
def test_surface_that_is_too_small(degree):
    """Contact reaches its rim at x = 0.5, where its body goes on; whichever body has it."""
    for body, upper, lower in (("lower", (0, 1, 4), (-1, 2, 6)), ("upper", (0, 1, 2), (-1, 2, 12))):
        warning = warned(lying(upper, lower, (body, -1, 0.5)), degree=degree)["uncovered"]
        assert warning.limit == 0.01 < warning.value < 0.5
        assert abs(warning.place[0] - 0.5) < 0.2 and warning.place[2] == 1.0
        assert f"reaches the rim of '{body} part'" in warning.message


@pytest.mark.parametrize(
    "upper, lower, named",
    [
        ((0, 1, 4), (-1, 2, 6), ()),
        ((0, 1, 2), (-1, 2, 12), ()),
        ((0, 1, 4), (-1, 2, 6), ("lower", 0, 1)),
        ((0, 1, 2), (-1, 2, 12), ("lower", 0, 1)),
        ((0, 1, 4), (-1, 0.5, 3), ()),
        ((0, 1, 4), (-1, 0.4, 3), ()),
    ],
    ids=["smaller first", "larger first", "seat second", "seat first", "over an edge", "over one inside a facet"],
)
def test_surface_that_is_large_enough(upper, lower, named):
    """It ends with its body, or where the other surface ends."""
    scene = lying(upper, lower, named)
    assert scene.pairing.nonmatching
    assert not warned(scene)


@pytest.mark.ranks(1, 2, 3)
def test_tie_that_is_free_in_part():
    """A tenth of the smaller surface may face nothing."""
    warning = warned(lying((0, 1, 4), (-1, 0.5, 3), glued=True))["uncovered"]
    assert (
        abs(warning.value - 0.5) < 1e-12 and warning.place == "upper bottom" and "50% of the area" in warning.message
    )
    assert not warned(lying((0, 1, 4), (-1, 0.95, 3), glued=True))
    assert not warned(lying((0, 1, 4), (-1, 2, 6), glued=True))


def test_unresolved_load():
    """A pressure that ends inside a facet: its total is off, unless the facet ends there too."""
    assert not warned(block(Pressure("top", lambda x: 0.01 * (x[0] < 2.0))))
    warning = warned(block(Pressure("top", lambda x: 0.01 * (x[0] < 1.3))))["unresolved load"]
    assert warning.place == "top" and warning.limit < warning.value and "pressure on 'top'" in warning.message
    assert abs(warning.value - 0.01 * (1 / 2 - 13 / 36)) < 1e-12, "two Gauss points a facet, three in each half"


def test_unresolved_forces_of_all_kinds():
    """Body forces and tractions that vary smoothly are resolved; one that is all inside a leaf is not."""
    smooth = BodyForce("block", lambda x: 1e-3 * np.stack([x[0], x[1] * x[2], 0 * x[0]]))
    assert not warned(block(smooth, Traction("top", lambda x: 1e-3 * np.stack([x[0], x[1], x[0] ** 2]))))
    narrow = BodyForce("block", lambda x: np.stack([0.001 * (np.abs(x[0] - 0.5) < 0.1)] * 3))
    warning = warned(block(narrow))["unresolved load"]
    assert warning.place == "block" and "total of 0 on this mesh" in warning.message


def test_constant_loads_are_not_integrated_twice(monkeypatch):
    """Only functions are."""
    calls, scene = [], block(Pressure("top", 0.01))
    monkeypatch.setattr(Pressure, "at", lambda self, x, n: calls.append(len(x)) or -0.01 * n)
    warned(scene)
    assert WORLD.allreduce(sum(calls)) == 3 * 2 * 4 and len(calls) <= 1


def test_no_load():
    """Zero displacements load nothing, an error without contact; any load or overlap does, also between the nodes."""
    with pytest.raises(ValidityError, match="nothing loads the scene 'block'.*no load"):
        solve(block(), 0.02)
    assert [*warned(block(), allow=("no load",))] == ["no load"]
    found = warned(hertz(1.0, 0.0, order=6, coarse=2))
    assert [*found] == ["no load", "no contact"] and found["no contact"].value == 0
    assert load_warnings(on_a_block(down=0.0)) and not load_warnings(on_a_block(down=0.0, gap=-1e-5))
    assert load_warnings(on_a_block(down=0.0, bulge=-1e-3)) and not load_warnings(on_a_block(down=0.0, bulge=1e-3))
    assert load_warnings(block()) and not load_warnings(block(Pressure("top", lambda x: x[0])))
    assert not load_warnings(block(BodyForce("block", (0.0, 0.0, -1e-9))))
    assert not load_warnings(stack(displacement=-1e-9)) and not load_warnings(shrink_fit())
    assert load_warnings(shrink_fit(interference=-0.01))


def test_place_of_the_largest_value():
    """Of places with the same value, but for rounding, the first by x, y, z, in whatever order they come."""
    points = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0]])
    values, more = np.array([2.0, 2.0, 2.0 - 1e-9, 1.0]), np.arange(4.0)[:, None]
    for order in permutations(range(4)):
        rows = np.roll(order, WORLD.rank)[: 4 if WORLD.rank == WORLD.size - 1 else 0]
        place, value, (which,) = _place_of_largest(WORLD, values[rows], points[rows], more[rows])
        assert (place, value, which) == ((0.0, 0.0, 1.0), 2.0, 2.0)


def test_record():
    """Warnings survive a file; lines of older records have none."""
    known = [
        ModelWarning("sliding", 2.0, 1.0, (0.0, 1.0, 2.0), "slides"),
        ModelWarning("large strain", 0.1, 0.05, "upper", "is strained"),
    ]
    entries = json.loads(json.dumps(step_record(0, doubts=known).as_json()))
    assert StepRecord.from_json(entries).doubts == known
    del entries["doubts"]
    assert StepRecord.from_json(entries).doubts == []


def test_sliding_of_a_round_contact():
    """Against the radius of the contact, not of the surface: a sphere on another one leaves it after a part of that."""
    scene = hertz(1.0, 0.05, coarse=2, order=2, symmetry="full")
    results = []
    for x in (0.0, 0.05):
        held = Dirichlet("bottom", 0.0, 0.0, 0.0), Dirichlet("top", x, 0.0, -0.05)
        results.append(warned(replace(scene, dirichlet=held), degree=2))
    assert not results[0] and 0.01 < results[1]["sliding"].limit < 0.03, results


def test_the_largest_pressure_at_a_corner_grows():
    """A cube on a block: it is infinite there, the goal is not reached, and the last record says that it grows."""
    scene = indentation(coarse=2)
    *before, last = adapt(scene, 0.3, goals=(MaxPressure(scene.contact[0].name, 0.2),), max_steps=6)
    assert not last.record.reached and [warning.kind for warning in last.record.doubts] == ["growing pressure"]
    assert not before[0].record.doubts
