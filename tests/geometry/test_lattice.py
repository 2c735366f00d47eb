"""Names of lattice points: the same from every cell that shares a point, different for different points."""

from types import SimpleNamespace

import numpy as np
import pytest
from conftest import WORLD
from model_problems import corner_scene, pressed, rotations, scramble, turned, two_boxes

from fx_contact.geometry import hexahedron
from fx_contact.geometry.lattice import (
    MAX_LEVEL,
    SIDE,
    Lattice,
    edge_midpoints,
    face_centres,
    leaf_corners,
    part_faces,
)
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.parallel.errors import GeometryError

pytestmark = pytest.mark.ranks(1)

#: Lattice coordinates along an axis, the same seen from both ends: ends, middle, and odd ones.
LINE = np.array([0, 1, SIDE // 4, 3 * SIDE // 8 - 1, SIDE // 2])
LINE = np.union1d(LINE, SIDE - LINE)


def grid(line=LINE):
    """All points of a tensor grid: (m, 3)."""
    return np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3).astype(np.int32)


def named(mesh, points):
    """Keys and positions of the same lattice points of all cells."""
    cell = np.arange(len(mesh.cells))
    keys = Lattice(mesh).keys(cell, np.broadcast_to(points, (len(cell), *points.shape)))
    corners = mesh.points[mesh.corners]
    weights = np.prod(np.where(hexahedron.CORNERS == 1, points[:, None] / SIDE, 1 - points[:, None] / SIDE), axis=2)
    return keys, np.einsum("mv,nvi->nmi", weights, corners)


def check(mesh, points):
    """Equal keys if and only if equal places, for a mesh of one body of straight cells; the number of shared points."""
    keys, x = (part.reshape(len(mesh.cells) * len(points), -1) for part in named(mesh, points))
    place = np.unique(np.round(x, 9), axis=0, return_inverse=True)[1].ravel()
    pairs = np.unique(np.stack([keys[:, 0], place], axis=1), axis=0)
    assert len(pairs) == len(np.unique(keys)) == len(np.unique(place)) and keys.dtype == np.int64 and keys.min() >= 0
    return len(keys) - len(pairs)


def test_rotations():
    """The 24 orientations of the fixture are different, and keep a cell right-handed."""
    nodes = {tuple(turned(np.arange(8), which)) for which in range(24)}
    assert len(rotations()) == len(nodes) == 24
    for row in nodes:
        edges = hexahedron.CORNERS[list(row)][[1, 2, 4]] - hexahedron.CORNERS[row[0]]
        assert np.linalg.det(edges) == 1


@pytest.mark.parametrize("axis", range(3))
def test_two_cells_in_all_frames(axis):
    """Two cells that share a face name its points alike, whatever the local frames of both (a third of them)."""
    low = grid(np.arange(2))[:, ::-1].astype(float)
    high = low + np.eye(3)[axis]
    x = np.unique(np.concatenate([low, high]), axis=0)
    shear = np.eye(3) + [[0, 0.3, 0.1], [0, 0, -0.2], [0.1, 0, 0]]
    number = {tuple(row): i for i, row in enumerate(x.tolist())}
    name = np.argsort(scramble(np.arange(12), axis))
    cells = np.array([[name[number[tuple(row)]] for row in corners.tolist()] for corners in (low, high)])
    place = np.empty_like(x)
    place[name] = x @ shear.T
    for first in range(24):
        for second in range((first + axis) % 3, 24, 3):
            frames = np.stack([turned(cells[0], first), turned(cells[1], second)])
            mesh = RootMesh(place, frames, ("body",), np.zeros(2, dtype=np.int32))
            assert check(mesh, grid()) == len(LINE) ** 2


def test_blocks_of_turned_cells():
    """In a block of many cells with random frames vertices, edges, faces and insides are named right."""
    for seed in range(3):
        both = two_boxes(upper=(3, 2, 2), distortion=0.2, seed=seed)
        upper = both.body == 1
        nodes, cells = np.unique(both.cells[upper], return_inverse=True)
        cells = cells.reshape(upper.sum(), -1)
        mesh = RootMesh(both.points[nodes], cells, ("upper",), np.zeros(len(cells), dtype=np.int32))
        assert check(mesh, grid()) > 1000


def test_irregular_edge():
    """Around an edge that three cells share, and one that five share, names agree."""
    for sectors in (3, 5):
        turn = 2 * np.pi / sectors * np.arange(sectors)
        spoke = np.stack([np.cos(turn), np.sin(turn)], axis=1)
        flat = np.concatenate([[[0, 0]], spoke, (spoke + np.roll(spoke, -1, axis=0)) * 0.8])
        points = np.concatenate([np.column_stack([flat, np.full(len(flat), z)]) for z in (0.0, 1.0)])
        quads = [[0, 1 + i, 1 + (i + 1) % sectors, 1 + sectors + i] for i in range(sectors)]
        cells = np.array([[*q, *(v + len(flat) for v in q)] for q in quads])
        for seed in range(8):
            frames = scramble(np.arange(sectors), seed) % np.uint64(24)
            nodes = np.array([turned(cell, int(frame)) for cell, frame in zip(cells, frames)])
            mesh = RootMesh(points, nodes, ("wheel",), np.zeros(sectors, dtype=np.int32))
            assert check(mesh, grid()) > 0


def test_bodies_share_no_names():
    """Points of two bodies at the same place have different keys."""
    scene = corner_scene()
    keys, x = named(scene.mesh, grid())
    lower, upper = keys[scene.mesh.body == 0], keys[scene.mesh.body == 1]
    places = [{tuple(row) for row in np.round(x[scene.mesh.body == b], 9).reshape(-1, 3).tolist()} for b in (0, 1)]
    assert places[0] & places[1]
    assert not np.intersect1d(lower, upper).size


@pytest.mark.parametrize("make", [lambda: pressed(two_boxes(margin=1)), corner_scene], ids=["boxes", "corner"])
def test_points_of_names(make):
    """What a key names is found again in the cell of its entity, a preferred one if there is one, else the lowest."""
    mesh = make().mesh
    names, count = Lattice(mesh), len(mesh.cells)
    points = np.broadcast_to(grid(), (count, len(grid()), 3))
    keys = names.keys(np.arange(count), points)
    preferred = np.zeros((count, 27), dtype=bool)
    preferred[count // 2] = True
    for prefer in (np.zeros_like(preferred), preferred):
        starts, cells, parts = names.entities(prefer)
        entity, found = names.located(keys.ravel(), (starts, cells, parts))
        assert np.array_equal(names.keys(cells[entity], found[:, None])[:, 0], keys.ravel())
        lowest = np.full(len(starts), count)
        np.minimum.at(lowest, entity.reshape(keys.shape), np.arange(count)[:, None])
        if prefer.any():
            lowest[entity.reshape(keys.shape)[count // 2]] = count // 2
        assert np.array_equal(cells, lowest)


def test_parts_lie_on_faces():
    """A corner on three, an edge on two, a face on one, the inside on none; each face has nine parts."""
    on = part_faces()
    assert on.sum(axis=0).tolist() == [9] * 6
    assert np.bincount(on.sum(axis=1)).tolist() == [1, 6, 12, 8]


@pytest.mark.skipif(WORLD.size > 1, reason="the same on every rank")
def test_most_cells():
    """250,000 cells that share nothing have names, all different, up to the last point; more are refused."""
    corners = np.arange(8 * 250_000).reshape(-1, 8)
    names = Lattice(SimpleNamespace(cells=corners, corners=corners))
    line = np.array([0, SIDE // 2, SIDE])
    keys = names.keys(np.array([0, 249_999]), np.broadcast_to(grid(line), (2, 27, 3)))
    assert keys.min() >= 0 and len(np.unique(keys)) == 54
    more = np.arange(8 * 263_000).reshape(-1, 8)
    with pytest.raises(GeometryError, match="263,000 cells"):
        Lattice(SimpleNamespace(cells=more, corners=more))


@pytest.mark.parametrize("level", [0, 1, 5, MAX_LEVEL])
def test_middles_are_lattice_points(level):
    """Midpoints of edges and centres of faces of leaves of any level are whole lattice points."""
    side = SIDE >> level
    anchor = np.array([[0, side * ((1 << level) - 1), side * ((1 << level) // 2)]], dtype=np.int32)
    corners = leaf_corners(anchor, np.array([level], dtype=np.int8))
    assert np.array_equal(np.ptp(corners[0], axis=0), [side] * 3) and corners.min() >= 0 and corners.max() <= SIDE
    for middles, groups in (
        (edge_midpoints(corners), hexahedron.EDGE_CORNERS),
        (face_centres(corners), hexahedron.FACE_CORNERS),
    ):
        exact = corners[:, groups].mean(axis=2)
        assert np.array_equal(middles, exact)
