"""Play and interference as a number, for pairs of two surfaces."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import WORLD
from model_problems import leaves

from fx_contact import (
    ContactPair,
    Dirichlet,
    Material,
    Scene,
    SymmetryPlane,
    adapt,
    block,
    join,
    root_mesh_from_shapes,
    solve,
    sweep,
)

pytestmark = pytest.mark.ranks(1, 2, 3)

DEPTH = 0.01
#: Inner, common and outer radius of the hollow spheres, their material.
RADII, STEEL = (20.0, 30.0, 40.0), Material(young=2000.0, poisson=0.3)


def hollow(inner, outer, cells=2, order=4):
    """An octant of a hollow sphere: three blocks, whose sides towards the centre and away from it have names."""

    def place(x):
        direction = np.stack([np.tan(np.pi / 4 * x[0]), np.tan(np.pi / 4 * x[1]), np.ones_like(x[0])])
        return (inner + (outer - inner) * x[2]) * direction / np.linalg.norm(direction, axis=0)

    cap = block((0, 0, 0), (1, 1, 1), (cells, cells, 1), order).placed(place).named("inside", "bottom")
    shell = join(*(replace(cap, points=np.roll(cap.points, turn, axis=1)) for turn in range(3)))
    for axis, name in enumerate("xyz"):
        shell = shell.named(f"{name} = 0", where=lambda x, axis=axis: np.abs(x[axis]) < 1e-9)
    for name, radius in (("inside", inner), ("outside", outer)):
        shell = shell.named(name, where=lambda x, radius=radius: np.abs(np.linalg.norm(x, axis=0) - radius) < 1e-6)
    return shell


def spheres(clearance):
    """An octant of a hollow sphere in another one, without loads."""
    a, b, c = RADII
    mesh = root_mesh_from_shapes({"inner": hollow(a, b), "outer": hollow(b, c)})
    planes = tuple(SymmetryPlane(f"{body} {side} = 0") for body in ("inner", "outer") for side in "xyz")
    pair = ContactPair("inner outside", "outer inside", clearance=clearance)
    return Scene("spheres", mesh, {"inner": STEEL, "outer": STEEL}, planes, (pair,), symmetry=8)


def lame():
    """Pressure of the interference, by the displacements of both surfaces for a unit pressure."""
    (a, b, c), nu = RADII, STEEL.poisson
    inner = ((1 - 2 * nu) * b**3 + (1 + nu) / 2 * a**3) / (b**3 - a**3)
    outer = ((1 - 2 * nu) * b**3 + (1 + nu) / 2 * c**3) / (c**3 - b**3)
    return DEPTH * STEEL.young / b / (inner + outer)


def test_pressed_spheres():
    """Without loads: Lame's contact pressure within 0.03 % in the mean, the largest within the tolerance."""
    assert abs(lame() / 0.2952 - 1) < 1e-4
    record = solve(spheres(-DEPTH), 0.02, degree=2).record
    assert record.reached
    assert abs(record.force / (lame() * 4 * np.pi * RADII[1] ** 2) - 1) < 3e-4
    assert 0 < record.max_pressure / lame() - 1 < 0.02


def test_path_through_zero():
    """Play, or no interference, loads nothing: the solution is zero, with a doubt."""
    points = list(sweep(spheres, [-DEPTH, 0.0, DEPTH], 0.1, degree=1))
    kinds = [[doubt.kind for doubt in point.step.record.doubts] for point in points]
    assert kinds == [[], ["no load", "no contact"], ["no load", "no contact"]]
    assert points[0].step.record.force > 0
    assert all(point.step.record.force == 0 and point.step.record.reached for point in points[1:])


def blocks(play=0.0, clearance=0.0, bulge=0.0, approach=0.03, cells=(2, 2, 1)):
    """A block pressed on another, `play` above it; its lower side bulges downwards between the edges."""

    def place(x):
        hill = 16 * x[0] * (1 - x[0]) * x[1] * (1 - x[1])
        return np.stack([x[0], x[1], x[2] - bulge * hill * (1 - x[2])])

    upper = block((0, 0, 0), (1, 1, 1), cells, 4).placed(place).shifted(z=play)
    mesh = root_mesh_from_shapes({"lower": block((0, 0, -1), (1, 1, 0), cells, 4), "upper": upper})
    held = (Dirichlet("lower bottom", x=0.0, y=0.0, z=0.0), Dirichlet("upper top", x=0.0, y=0.0, z=-approach))
    pair = ContactPair("upper bottom", "lower top", (0.0, 0.0, -1.0), clearance=clearance)
    return Scene("blocks", mesh, dict.fromkeys(mesh.bodies, Material(1.0, 0.3)), held, (pair,))


@pytest.mark.parametrize("clearance", [0.01, -0.01])
@pytest.mark.parametrize("degree", [1, 2])
def test_as_bodies_apart(degree, clearance):
    """A clearance between planes is that of bodies so far apart: the same leaves and forces."""
    runs = [list(adapt(scene, 0.15, degree=degree)) for scene in (blocks(clearance), blocks(clearance=clearance))]
    assert len(runs[0]) == len(runs[1]) > 1
    for one, other in zip(*runs):
        assert np.array_equal(leaves(one.forest), leaves(other.forest))
        assert abs(one.record.force / other.record.force - 1) < 1e-7
        gaps = (np.sort(np.concatenate(WORLD.allgather(step.contact.gap))) for step in (one, other))
        assert np.allclose(*gaps, rtol=0, atol=1e-9)
    known = solve(blocks(approach=0.03 - clearance), 0.15, degree=degree).record
    assert abs(runs[0][-1].record.force / known.force - 1) < 1e-7


def test_contact_between_nodes():
    """A bulge in the middle of facets, which the clearance lets touch or not."""
    options = {"bulge": 0.01, "approach": 0.0, "cells": (3, 1, 1)}
    for play, found in ((0.008, True), (0.012, False)):
        for scene in (blocks(play, **options), blocks(clearance=play, **options)):
            record = next(adapt(scene, 0.3, degree=1, allow=("no load",))).record
            assert record.active_pairs == 0
            assert (record.penetrated_leaves > 0) == found


def test_warnings():
    """A deep interference is an initial overlap; the distance of open bodies has the clearance."""
    record = next(adapt(blocks(clearance=-0.3, approach=0.0), 0.2)).record
    assert "initial overlap" in [doubt.kind for doubt in record.doubts]
    (doubt,) = next(adapt(blocks(clearance=0.05), 0.2)).record.doubts
    assert doubt.kind == "no contact" and abs(doubt.value - 0.02) < 1e-9
