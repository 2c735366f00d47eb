"""Geometry of leaf facets by name: as the forest has it, whatever the order and the leaf."""

import numpy as np
import pytest
from model_problems import scramble

from fx_contact.geometry import hexahedron
from fx_contact.geometry.lattice import SIDE, leaf_side
from fx_contact.geometry.leaf_facets import CORNERS, LeafFacets
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.geometry.shapes import root_mesh_from_shapes
from fx_contact.geometry.solids import ball, block, ring

pytestmark = pytest.mark.ranks(1)

ORDERS = 1, 2, 3, 6


def random_facets(mesh: RootMesh, facets, count, deepest=5, salt=0):
    """Leaf facets at random places of some root facets, and the leaves that have them."""
    draw = [scramble(np.arange(count), salt + k) for k in range(5)]
    cell, face = facets[(draw[0] % np.uint64(len(facets))).astype(int)].T
    level = (draw[1] % np.uint64(deepest + 1)).astype(np.int8)
    anchor = np.stack([(d >> np.uint64(11)).astype(np.int64) % SIDE for d in draw[2:]], axis=1)
    side = leaf_side(level)[:, None]
    anchor = anchor // side * side
    axis, high = hexahedron.FACE_AXIS[face], hexahedron.FACE_SIDE[face]
    anchor[np.arange(count), axis] = np.where(high == 1, SIDE - side[:, 0], 0)
    anchor = anchor.astype(np.int32)
    return LeafFacets.of_leaves(mesh, cell, level, anchor, face.astype(np.int64)), (cell, level, anchor, face)


@pytest.fixture(params=ORDERS)
def mesh(request):
    """A ball and a block apart, with facets of all six local faces."""
    return root_mesh_from_shapes(
        {"ball": ball(1.0, 2, request.param), "block": block((3, 0, 0), (4, 1, 1), (2, 1, 2), request.param)}
    )


def every_facet(mesh):
    return np.concatenate(list(mesh.surfaces.values()))


def test_positions_are_those_of_the_leaves(mesh):
    """Points at the lattice coordinates of nodes of the leaves; corners, orientation, area and mean normal."""
    facets, (cell, level, anchor, face) = random_facets(mesh, every_facet(mesh), 200)
    assert set(face) == set(range(6)) and len(set(level)) == 6
    assert (facets.cell == cell).all() and (facets.face == face).all()
    nodes = (
        anchor[:, None]
        + leaf_side(level)[:, None, None] * hexahedron.grid_points(2)[hexahedron.face_nodes(2)[face]] / 2
    )
    places = mesh.evaluate(np.repeat(cell, 9), nodes.reshape(-1, 3, 1) / SIDE).reshape(-1, 9, 3)
    v, u = np.divmod(np.arange(9), 3)
    uv = np.broadcast_to(np.stack([u, v], axis=1) / 2, (200, 9, 2))
    assert np.abs(facets.at(uv).position - places).max() < 1e-14
    assert np.abs(facets.corners - places[:, [0, 2, 6, 8]]).max() < 1e-14
    part = facets[np.arange(7, 50, 3)]
    assert np.array_equal(part.corners, facets.corners[7:50:3])
    ball_facets = mesh.body[cell] == 0
    at = facets.at(uv)
    outward = np.einsum("nmi,nmi->nm", at.normal, at.position)[ball_facets]
    assert (outward > 0.9).all() and (np.linalg.norm(at.normal, axis=2) - 1 < 1e-14).all()
    assert (np.einsum("ni,nmi->nm", facets.mean_normal, at.normal) > 0.7).all()
    direct = np.linalg.norm(
        np.cross(facets.corners[:, 1] - facets.corners[:, 0], facets.corners[:, 2] - facets.corners[:, 0]), axis=1
    )
    flat = ~ball_facets
    assert flat.any() and np.allclose(np.linalg.norm(facets.mean_outward, axis=1)[flat], direct[flat], rtol=1e-12)


def test_derivatives(mesh):
    """Tangents are difference quotients; the Jacobian is the area of their product."""
    facets, _ = random_facets(mesh, every_facet(mesh), 100, salt=7)
    uv, step = np.full((100, 1, 2), 0.37), 1e-5
    at = facets.at(uv)
    for axis, tangent in enumerate((at.first, at.second)):
        shift = step * np.eye(2)[axis]
        slope = (facets.at(uv + shift).position - facets.at(uv - shift).position) / (2 * step)
        assert np.abs(slope - tangent).max() < 1e-9
    assert np.allclose(at.jacobian, np.linalg.norm(np.cross(at.first, at.second), axis=2), rtol=1e-14)


def test_lines(mesh):
    """A line through a point of a facet meets it there, from anywhere on the line."""
    facets, (cell, *_) = random_facets(mesh, every_facet(mesh), 300, salt=11)
    uv = np.stack([scramble(np.arange(300), k) / 2.0**64 for k in (1, 2)], axis=1)[:, None]
    at = facets.at(uv)
    direction = at.normal + 0.2 * at.first / np.linalg.norm(at.first, axis=2)[..., None]
    for distance in (0.0, 0.3, -2.0):
        found, met = facets.on_lines(at.position + distance * direction, direction, np.full((300, 1, 2), 0.5))
        assert met.all() and np.abs(found - uv).max() < 1e-11
    beside = at.first / np.linalg.norm(at.first, axis=2)[..., None]
    flat = mesh.body[cell] == 1
    _, met = facets[flat].on_lines(at.position[flat] + at.normal[flat], beside[flat], uv[flat])
    assert len(met) and not met.any()


def test_area_of_a_ring():
    """The inside of a ring of radius 2 and length 3: normals towards the axis, area 12 pi."""
    mesh = root_mesh_from_shapes({"ring": ring(2.0, 3.0, 3.0, (1, 2, 1))})
    rows = mesh.surfaces["ring inside"]
    level, anchor = np.zeros(len(rows), dtype=np.int8), np.zeros((len(rows), 3), dtype=np.int32)
    facets = LeafFacets.of_leaves(mesh, rows[:, 0], level, anchor, rows[:, 1])
    points, weights = np.polynomial.legendre.leggauss(12)
    uv = np.stack(np.meshgrid((points + 1) / 2, (points + 1) / 2), axis=-1).reshape(-1, 2)
    at = facets.at(np.broadcast_to(uv, (len(rows), *uv.shape)))
    area = (at.jacobian @ np.kron(weights, weights) / 4).sum()
    assert abs(area - 12 * np.pi) < 1e-7 * area
    radial = at.position * [1, 1, 0] / 2
    assert np.abs(np.einsum("nmi,nmi->nm", radial, at.normal) + 1).max() < 1e-6
    assert np.array_equal(facets.corners, facets.at(np.broadcast_to(CORNERS, (len(rows), 4, 2))).position)
