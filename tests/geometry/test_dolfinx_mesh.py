"""Root meshes from dolfinx: the same cells, nodes and names on any number of ranks as made directly."""

import numpy as np
import pytest
from basix import LagrangeVariant
from conftest import WORLD
from dolfinx import mesh as dolfinx_mesh
from dolfinx.mesh import compute_midpoints, locate_entities
from dolfinx_meshes import of_dolfinx, tagged
from model_problems import pressed, two_boxes
from mpi4py import MPI

from fx_contact import Dirichlet, GeometryError, Material, RootMesh, Scene, SceneError, contacts_between, solve
from fx_contact.scene.fingerprint import mesh_digest
from fx_contact.scenes import hertz


def box(kind=dolfinx_mesh.CellType.hexahedron):
    """A box of 4 x 2 x 2 blocks."""
    return dolfinx_mesh.create_box(WORLD, [(0, 0, 0), (2, 1, 1)], (4, 2, 2), kind)


def disjoint(root):
    """A root mesh whose surfaces have no facet in common, as those of tags; the later ones keep them."""
    kept, taken = {}, set()
    for name, rows in reversed(root.surfaces.items()):
        own = np.array([row for row in rows.tolist() if tuple(row) not in taken])
        taken |= set(map(tuple, rows.tolist()))
        if len(own):
            kept[name] = own[np.lexsort(own.T[::-1])]
    return RootMesh(root.points, root.cells, root.bodies, root.body, dict(reversed(kept.items())))


@pytest.mark.parametrize("variant", [LagrangeVariant.equispaced, LagrangeVariant.gll_warped])
@pytest.mark.parametrize("order", [1, 2, 3, 6])
def test_comes_back(order, variant):
    """Curved boxes in random local frames, and a quarter of two half-spheres."""
    for mesh in (two_boxes(order=order, bend=0.1), hertz(order=order, coarse=2).mesh):
        root = disjoint(mesh)
        again = RootMesh.from_dolfinx(*of_dolfinx(root, variant))
        assert np.abs(again.points - root.points).max() < 1e-12
        assert np.array_equal(again.cells, root.cells) and again.bodies == root.bodies
        assert mesh_digest(again) == mesh_digest(root)


def test_contact_on_it():
    """A run on it has the same force, to the solver's tolerance, as on the mesh it was made from."""
    root = disjoint(two_boxes(margin=1, order=2))
    one, other = (solve(pressed(mesh), 0.2) for mesh in (root, RootMesh.from_dolfinx(*of_dolfinx(root))))
    assert one.record.cells == other.record.cells
    assert abs(other.record.force / one.record.force - 1) < 1e-9


def test_a_box_of_dolfinx():
    """What `create_box` makes, with the facets of its top."""
    mesh, other = box(), box()
    cells = np.arange(mesh.topology.index_map(3).size_local)
    cell_tags, others_tags = tagged(mesh, 3, cells, 3), tagged(other, 3, cells, 3)
    top = dolfinx_mesh.locate_entities_boundary(mesh, 2, lambda x: np.isclose(x[2], 1))
    facet_tags = tagged(mesh, 2, np.sort(top), 5)
    root = RootMesh.from_dolfinx(mesh, cell_tags, facet_tags, {3: "box"}, {5: "top"})
    assert root.bodies == ("box",) and len(root.cells) == 16 and len(root.points) == 45
    assert len(root.surfaces["top"]) == 8 and (root.facet_points(root.surfaces["top"])[:, :, 2] == 1).all()
    assert WORLD.allgather(mesh_digest(root)) == [mesh_digest(root)] * WORLD.size
    bad = {
        "cell_tags are of another mesh": (other, cell_tags, facet_tags, {3: "box"}, {}),
        "facet_tags are of another mesh": (other, others_tags, facet_tags, {3: "box"}, {}),
        "in no body": (mesh, cell_tags, facet_tags, {4: "box"}, {}),
        "each of them cells": (mesh, cell_tags, facet_tags, {3: "box", 4: "other"}, {}),
        "nothing in the mesh has its tag": (mesh, cell_tags, facet_tags, {3: "box"}, {6: "top"}),
        "bodies must be a dict of tag -> name": (mesh, cell_tags, facet_tags, {"box": 3}, {}),
        "surfaces must be a dict of tag -> name": (mesh, cell_tags, facet_tags, {3: "box"}, {"top": 5}),
        "must be MeshTags of dolfinx of dimension 3, got None": (mesh, None, facet_tags, {3: "a", 4: "b"}, {}),
        "cell_tags must be MeshTags of dolfinx of dimension 3": (mesh, facet_tags, facet_tags, {3: "box"}, {}),
        "a Mesh of dolfinx is needed": (root, cell_tags, facet_tags, {3: "box"}, {}),
    }
    for words, arguments in bad.items():
        with pytest.raises(SceneError, match=words):
            RootMesh.from_dolfinx(*arguments)
    if WORLD.size > 1:
        with pytest.raises(SceneError, match="communicator"):
            RootMesh.from_dolfinx(mesh, cell_tags, facet_tags, {3: "box"}, {}, MPI.COMM_SELF)


def test_several_tags_of_one_surface():
    """A surface has the facets of all tags of its name; one body needs no tags."""
    mesh = box()
    ends = [dolfinx_mesh.locate_entities_boundary(mesh, 2, lambda x, at=at: np.isclose(x[0], at)) for at in (0, 2)]
    facets, tags = np.concatenate(ends), np.repeat([1, 2], [len(end) for end in ends])
    order = np.argsort(facets)
    facet_tags = tagged(mesh, 2, facets[order], tags[order])
    root = RootMesh.from_dolfinx(mesh, None, facet_tags, {1: "box"}, {1: "ends", 2: "ends"})
    assert root.bodies == ("box",) and not root.body.any() and len(root.body) == 16
    at = root.facet_points(root.surfaces["ends"])[:, :, 0]
    assert (at == 0).all(axis=1).sum() == (at == 2).all(axis=1).sum() == 4 and len(at) == 8


@pytest.mark.parametrize("kind", [dolfinx_mesh.CellType.tetrahedron, dolfinx_mesh.CellType.prism])
def test_other_cells(kind):
    """Only hexahedra can be refined."""
    mesh = box(kind)
    with pytest.raises(GeometryError, match=kind.name):
        RootMesh.from_dolfinx(mesh, tagged(mesh, 3, [], []), tagged(mesh, 2, [], []), {}, {})


def two_halves(joint=7):
    """The box in two bodies that share nodes, with tags of its ends and of the facets between them."""
    mesh = box()
    middle = compute_midpoints(mesh, 3, np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32))
    cell_tags = tagged(mesh, 3, np.arange(len(middle)), np.where(middle[:, 0] < 1, 1, 2))
    places = {5: 0.0, joint: 1.0, 6: 2.0}
    facets = [locate_entities(mesh, 2, lambda x, at=at: np.isclose(x[0], at)) for at in places.values()]
    order, tags = np.argsort(np.concatenate(facets)), np.repeat([*places], [len(some) for some in facets])
    return mesh, cell_tags, tagged(mesh, 2, np.concatenate(facets)[order], tags[order])


def test_bodies_cut_apart():
    """Two halves of a box press each other along facets that they shared; each keeps its part of a named surface."""
    given = *two_halves(), {1: "left", 2: "right"}, {5: "left end", 6: "right end", 7: "joint"}
    with pytest.raises(SceneError, match="bodies 'left' and 'right' share .*: cut them apart .`split=True`"):
        RootMesh.from_dolfinx(*given)
    with pytest.raises(SceneError, match="`split` must be True or False, got 1"):
        RootMesh.from_dolfinx(*given, split=1)
    with pytest.raises(SceneError, match="`split` makes two surfaces 'left to right'"):
        RootMesh.from_dolfinx(*given[:-1], {5: "left to right"}, split=True)
    with pytest.raises(SceneError, match="no facet lies between two bodies"):
        RootMesh.from_dolfinx(*given[:3], {1: "box", 2: "box"}, {}, split=True)
    root = RootMesh.from_dolfinx(*given, split=True)
    assert set(root.surfaces) == {
        "left end",
        "right end",
        "left to right",
        "right to left",
        "left joint",
        "right joint",
    }
    assert len(root.points) == 5 * 9 + 9 and len(root.cells) == 16
    for name, other in (("left to right", "left joint"), ("right to left", "right joint")):
        assert np.array_equal(root.surfaces[name], root.surfaces[other]) and len(root.surfaces[name]) == 4
        assert np.allclose(root.facet_points(root.surfaces[name])[..., 0], 1)
    scene = Scene(
        "halves",
        root,
        {"left": Material(1.0, 0.0), "right": Material(1.0, 0.0)},
        (Dirichlet("left end", 0, 0, 0), Dirichlet("right end", -0.02)),
        contacts_between(root, within=1e-6),
    )
    assert len(scene.contact) == 1 and solve(scene, 0.1).record.force == pytest.approx(0.01, rel=1e-6)
