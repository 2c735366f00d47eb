"""Root meshes from dolfinx: the same cells, nodes and names on any number of ranks as made directly."""

import numpy as np
import pytest
from basix import LagrangeVariant
from conftest import WORLD
from dolfinx import mesh as dolfinx_mesh
from dolfinx_meshes import of_dolfinx, tagged
from model_problems import pressed, two_boxes
from mpi4py import MPI

from fx_contact import GeometryError, RootMesh, SceneError, solve
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
