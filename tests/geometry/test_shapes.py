"""Shapes: volumes and areas as exact as their order, facets that match, and what is no shape."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from fx_contact import (
    ContactPair,
    GeometryError,
    SceneError,
    ball,
    block,
    cylinder,
    extrude,
    join,
    revolve,
    ring,
    root_mesh_from_shapes,
    sweep_side,
)
from fx_contact.geometry import hexahedron
from fx_contact.surfaces.facet_pairing import Pairing


def measures(shape):
    """Volume of a shape, and area of each of its sides; of its mesh, which is checked when made."""
    mesh = root_mesh_from_shapes({"body": shape})
    points, weights = np.polynomial.legendre.leggauss(2 * mesh.order + 3)
    points, weights = (points + 1) / 2, weights / 2
    value, slope = hexahedron.lagrange(mesh.order, points), hexahedron.lagrange_derivative(mesh.order, points)
    tables = [[slope if axis == other else value for other in range(3)] for axis in range(3)]
    columns = [hexahedron.tensor_evaluate(table, mesh.points[mesh.cells]) for table in tables]
    volume = (np.linalg.det(np.stack(columns, axis=-1)) @ np.kron(weights, np.kron(weights, weights))).sum()
    areas = {}
    for name in shape.sides:
        nodes = mesh.facet_points(mesh.surfaces[f"body {name}"]).transpose(2, 0, 1)
        tangents = [nodes @ np.kron(*pair).T for pair in ((value, slope), (slope, value))]
        areas[name] = (np.linalg.norm(np.cross(*tangents, axis=0), axis=0) @ np.kron(weights, weights)).sum()
    return volume, areas


def test_block():
    """A block has its volume, and six sides of its faces."""
    volume, areas = measures(block((-1, 0, 2), (1, 3, 2.5), (1, 2, 3), order=2))
    assert abs(volume - 3) < 1e-13
    exact = {"left": 1.5, "right": 1.5, "front": 1, "back": 1, "bottom": 6, "top": 6}
    assert areas == pytest.approx(exact, rel=1e-12)


PI = np.pi
#: Solids of n cells along each edge, their volume and the areas of their sides.
ROUND = {
    "ring": (lambda n, p: ring(1, 2, 3, (n, n, n), p), 9 * PI, {"inside": 6 * PI, "outside": 12 * PI, "top": 3 * PI}),
    "half a ring": (lambda n, p: ring(1, 2, 3, (n, n, n), p, 2), 4.5 * PI, {"inside": 3 * PI, "x = 0": 6}),
    "cylinder": (lambda n, p: cylinder(2, 3, (n, n), p), 12 * PI, {"outside": 12 * PI, "bottom": 4 * PI}),
    "quarter": (lambda n, p: cylinder(2, 3, (n, n), p, 1), 3 * PI, {"outside": 3 * PI, "x = 0": 6, "y = 0": 6}),
    "ball": (lambda n, p: ball(2, n, p), 32 / 3 * PI, {"outside": 16 * PI}),
    "octant": (lambda n, p: ball(2, n, p, 1), 4 / 3 * PI, {"outside": 2 * PI, "x = 0": PI, "y = 0": PI, "z = 0": PI}),
    "half a ball": (lambda n, p: ball(2, n, p, 4), 16 / 3 * PI, {"outside": 8 * PI, "z = 0": 4 * PI}),
    "revolved": (lambda n, p: torus(n, p), 2 * PI * 3, {"left": 4 * PI, "right": 8 * PI, "back": 3 * PI}),
}


def torus(n, order):
    """A ring of square section, of a face that is turned about the y axis."""
    return revolve(block((1, 0, 0), (2, 2, 1), (n, n, 1), order), "bottom", 360, 4 * n, axis="y")


@pytest.mark.parametrize("kind", ROUND)
@pytest.mark.parametrize("order", [1, 2, 3])
def test_round_solids_converge(kind, order):
    """Volumes and areas tend to the exact ones with h^(p+1), whatever part is made, in one conforming body."""
    make, volume, areas = ROUND[kind]
    errors = []
    for n in (1, 2):
        found, sides = measures(make(n, order))
        errors.append([found / volume - 1, *(sides[name] / area - 1 for name, area in areas.items())])
    coarse, fine = np.abs(errors)
    assert fine.max() < (0.2, 1e-3, 2e-4)[order - 1]
    rates = np.log2(np.maximum(coarse, 1e-300) / np.maximum(fine, 1e-300))
    assert (rates[coarse > 1e-10] > order + 0.6).all(), rates


def test_round_sides_have_all_nodes_on_them():
    """Nodes of any order are on the cylinder, sphere or cone, to rounding."""
    for shape, flat in (
        (cylinder(2, 3, (2, 1), 5), [1, 1, 0]),
        (ball(2, 2, 5), [1, 1, 1]),
        (ring(1, 2, 1, (1, 2, 1), 6), [1, 1, 0]),
    ):
        mesh = root_mesh_from_shapes({"body": shape})
        nodes = mesh.facet_points(mesh.surface("body outside")).reshape(-1, 3)
        assert np.abs(np.linalg.norm(nodes * flat, axis=1) - 2).max() < 1e-14


@pytest.mark.parametrize("n, order", [(1, 1), (2, 2), (1, 4)])
def test_what_is_swept_matches(n, order):
    """A body on a curved face of another, with a gap that varies, faces it node by node; so do shaft and bore."""
    lower = cylinder(1, 0.5, (n, n), order, quarters=1).named("face", "outside", where=lambda x: x[0] > 0.99 * x[1])

    def path(x, t):
        return (1 - t) * (2 - np.sqrt(1 - x[2] ** 2)) + 2 * t, x[1], x[2]

    upper = sweep_side(lower, "face", path, 3)
    mesh = root_mesh_from_shapes({"lower": lower, "upper": upper})
    pairing = Pairing(mesh, (ContactPair("lower face", "upper start", direction=(1, 0, 0)),))
    assert pairing.paired.sum() / 2 == len(mesh.surface("upper start")) == n * n
    assert len(mesh.cells) == 3 * n**2 * n + 3 * n**2
    shaft, bore = cylinder(0.999, 1, (n, n), order), ring(1, 2, 1, (1, 2 * n, n), order)
    mesh = root_mesh_from_shapes({"shaft": shaft, "bore": bore})
    assert Pairing(mesh, (ContactPair("shaft outside", "bore inside"),)).paired.sum() == 2 * 8 * n**2


def test_swept_sides():
    """A sweep is called as what it borders on; its volume is that between the surfaces, towards either side."""
    base = block((0, 0, 0), (1, 1, 1), (2, 2, 1), 2)
    for side, vector in (("top", (0, 0, 2)), ("left", (-2, 0, 0)), ("front", (0, -2, 0.5)), ("top", (0, 0, -2))):
        shape = extrude(base, side, vector, 2)
        volume, areas = measures(shape)
        assert abs(volume - 2) < 1e-13
        beside = base.sides.keys() - {side, {"top": "bottom", "left": "right", "front": "back"}[side]}
        assert areas.keys() == {"start", "end"} | beside
        assert (areas["start"], areas["end"]) == pytest.approx((1, 1))
    mesh = root_mesh_from_shapes({"it": extrude(base, "top", (0, 0, 2), 2)})
    for name, axis, at in (("left", 0, 0), ("right", 0, 1), ("front", 1, 0), ("back", 1, 1), ("start", 2, 1)):
        assert (mesh.facet_points(mesh.surface(f"it {name}"))[..., axis] == at).all()
    assert (
        "back"
        not in extrude(base.named("part", where=lambda x: (x[1] < 0.6) & (x[2] == 1)), "part", (0, 0, 1), 1).sides
    )


def test_a_swept_base_is_widened():
    """The contact side that one part brings alone faces its partner; one that both bring is too large to match."""
    punch = block((0, 0, 0), (1, 1, 1), (2, 2, 1), 2)
    base = extrude(punch, "bottom", (0, 0, -1), 1)
    outer = extrude(base, "right", (2, 0, 0), 2)
    bodies = {"punch": punch, "base": join(base.named("contact", "start"), outer)}
    assert measures(bodies["base"])[1] == pytest.approx(
        {"start": 3, "end": 3, "left": 1, "front": 3, "back": 3, "contact": 1}
    )
    mesh = root_mesh_from_shapes(bodies)
    assert Pairing(mesh, (ContactPair("punch bottom", "base contact"),)).paired.sum() == 2 * 4
    for sides in (("punch bottom", "base start"), ("base start", "punch bottom")):
        pairing = Pairing(mesh, (ContactPair(*sides),))
        assert "facets face" in pairing.nonmatching[0] and not pairing.paired.any()


def test_motions():
    """A shape that is shifted, turned, mirrored or placed has its volume and sides there; right angles are exact."""
    shape = block((1, 0, 0), (2, 3, 4), (1, 2, 1), 2)
    for moved, low, left in (
        (shape.shifted(z=1), (1, 0, 1), (1, 0)),
        (shape.turned("z", 90), (-3, 1, 0), (1, 1)),
        (shape.turned("z", -270), (-3, 1, 0), (1, 1)),
        (shape.turned("x", 180), (1, -3, -4), (1, 0)),
        (shape.turned((1, 1, 1), 120), (0, 1, 0), (1, 1)),
        (shape.mirrored("x"), (-2, 0, 0), (-1, 0)),
        (shape.mirrored("y"), (1, -3, 0), (1, 0)),
        (shape.placed(lambda x: (x[0], x[1], x[2] - 4)), (1, 0, -4), (1, 0)),
    ):
        assert abs(measures(moved)[0] - 12) < 1e-12
        assert np.abs(moved.points.min(axis=0) - low).max() < 1e-15
        mesh = root_mesh_from_shapes({"it": moved})
        assert np.abs(mesh.facet_points(mesh.surface("it left"))[..., left[1]] - left[0]).max() < 1e-15
    assert measures(shape.turned("y", 30))[0] == pytest.approx(12)


def test_joined():
    """Nodes at one place become one; inner facets leave their sides, others of one name are one side."""
    one = block((0, 0, 0), (1, 1, 1), (1, 2, 2), 2)
    both = join(one, one.shifted(x=1))
    assert len(both.points) == 5 * 5 * 5 and both.order == 2
    volume, areas = measures(both)
    assert abs(volume - 2) < 1e-13
    assert areas == pytest.approx({"left": 1, "right": 1, "front": 2, "back": 2, "bottom": 2, "top": 2})
    assert "left" not in join(one, one.mirrored("x")).sides
    # What is a rounding apart is joined, what is a millionth apart is not.
    assert [len(join(one, one.shifted(x=1 + apart)).points) for apart in (1e-13, 1e-6)] == [125, 150]


@pytest.mark.parametrize(
    "make, there",
    [
        (lambda **parts: ring(1, 2, 1, (1, 1, 1), 1, **parts), {1: "", 2: "y", 4: "xy"}),
        (lambda **parts: cylinder(1, 1, (1, 1), 1, **parts), {1: "", 2: "y", 4: "xy"}),
        (lambda **parts: ball(1, 1, 1, **parts), {1: "", 2: "y", 4: "xy", 8: "xyz"}),
    ],
)
def test_which_part_is_made(make, there):
    """Coordinates that have both signs in a part of so many quarters or octants; the others are not negative."""
    for count, axes in there.items():
        low = make(**{"octants" if 8 in there else "quarters": count}).points.min(axis=0)
        assert [axis for axis, value in zip("xyz", low) if value < -1e-12] == list(axes)


@pytest.mark.parametrize("degrees, ends", [(360, 0), (-360, 0), (180, 2)])
def test_a_full_circle_is_closed(degrees, ends):
    """Either way round: its ends are no sides."""
    face = block((1, 0, 0), (2, 2, 1), (1, 1, 1), 1)
    assert len({"start", "end"} & revolve(face, "bottom", degrees, 4, axis="y").sides.keys()) == ends


def test_named_places():
    """Surfaces of several sides, curves and vertices by place, each edge once."""
    one, two = (block((0, 0, z), (1, 1, z + 1), (2, 2, 2), 2) for z in (0, 1.5))
    one = one.named("spot", "top", where=lambda x: (x[0] <= 0.5) & (x[1] <= 0.5)).named("skin")
    surfaces = {"x = 0": ["one left", "two left"], "spot": "one spot", "skin": "one skin"}
    axis, tip = lambda x: (x[0] == 0.5) & (x[1] == 0.5), lambda x: (x == 0).all(axis=0)
    mesh = root_mesh_from_shapes({"one": one, "two": two}, surfaces, {"axis": ("two", axis)}, {"tip": ("one", tip)})
    assert [len(mesh.surfaces[name]) for name in surfaces] == [8, 1, 24] and "two top" in mesh.surfaces
    cell, edge = mesh.curves["axis"].T
    ends = mesh.points[mesh.corners[cell[:, None], hexahedron.EDGE_CORNERS[edge]]]
    assert sorted(map(tuple, np.round(ends.mean(axis=1), 12))) == [(0.5, 0.5, 1.75), (0.5, 0.5, 2.25)]
    assert (mesh.points[mesh.vertices["tip"]] == 0).all() and len(mesh.vertices["tip"]) == 1
    assert mesh.surface("spot").dtype == np.int32


def test_mirrored_parts_are_symmetric():
    """The whole of a ball or cylinder is its own mirror image."""
    for whole in (ball(1, 2, 3), cylinder(1, 1, (2, 1), 3), ring(1, 2, 1, (1, 1, 1), 3)):
        for axis in range(2):
            image = whole.points * np.where(np.arange(3) == axis, -1, 1)
            assert cKDTree(whole.points).query(image)[0].max() < 1e-15


CUBE = block((0, 0, 0), (1, 1, 1), (1, 1, 1), 1)


@pytest.mark.parametrize(
    "make, error, message",
    [
        (lambda: block((0, 0), (1, 1), (1, 1)), SceneError, "three components"),
        (lambda: block((0, 0, 0), (1, 1, 1), (1, 0, 1)), SceneError, "each number of cells must be a whole number"),
        (lambda: cylinder(1, -1, (1, 1)), SceneError, "length must be a positive number"),
        (lambda: cylinder(1, 1, ("a", 1)), SceneError, "the numbers of cells must be a finite number, got 'a'"),
        (lambda: ball("1", 1), SceneError, "radius must be a positive number"),
        (lambda: CUBE.named("x", where=lambda x: x), GeometryError, "a truth value for each of 8 points"),
        (lambda: CUBE.named(3), SceneError, "a side must be a name, got 3"),
        (lambda: CUBE.placed((0, 0, 0)), GeometryError, "gives finite x, y and z, got (0, 0, 0)"),
        (lambda: CUBE.placed(lambda x: (x[0], x[1], np.nan)), GeometryError, "finite"),
        (lambda: CUBE.shifted(z="up"), SceneError, "the shift x, y or z must be a finite number"),
        (lambda: CUBE.turned((0, 0, 0), 90), GeometryError, "got zero"),
        (lambda: CUBE.mirrored("xy"), SceneError, "unknown axis 'xy'"),
        (lambda: sweep_side(CUBE, "top", lambda x, t: 1.0, 1), GeometryError, "the path must be a function"),
        (lambda: join(), GeometryError, "got orders []"),
        (lambda: join(3), SceneError, "what is joined must be a tuple of Shape, got 3"),
        (lambda: join(CUBE, ball(1, 1)), GeometryError, "one order"),
        (lambda: root_mesh_from_shapes({"a": CUBE, "b": ball(1, 1)}), GeometryError, "one order"),
        (
            lambda: root_mesh_from_shapes([CUBE]),
            GeometryError,
            "bodies must be a dict of at least one name and Shape",
        ),
        (lambda: root_mesh_from_shapes({"a": CUBE}, ["x"]), SceneError, "surfaces must be a dict by name, got ['x']"),
        (
            lambda: root_mesh_from_shapes({"a": CUBE}, {"x": 3}),
            SceneError,
            "the sides of surface 'x' must be a tuple of str",
        ),
        (lambda: root_mesh_from_shapes({"a": CUBE}, curves={"c": ("b", None)}), SceneError, "unknown body 'b'"),
        (lambda: root_mesh_from_shapes({"a": extrude(CUBE, "top", (1, 0, 0), 1)}), GeometryError, "degenerate"),
    ],
)
def test_errors(make, error, message):
    """What cannot be built is refused, with what it is."""
    with pytest.raises(error) as caught:
        make()
    assert message in str(caught.value)
