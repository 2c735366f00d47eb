"""Root meshes of Gmsh: named groups at their place, elements that belong to no cell, subdivided tetrahedra."""

import numpy as np
import pytest
from mpi4py import MPI

from fx_contact import SceneError, contacts_between
from fx_contact.geometry import hexahedron
from fx_contact.geometry.gmsh_mesh import root_mesh_from_gmsh
from fx_contact.items.contact import ContactPair
from fx_contact.surfaces.facet_pairing import Pairing

gmsh = pytest.importorskip("gmsh")


def box(beside=False):
    """A unit cube, and names of its top, an edge and a corner; `beside`: a quadrangle apart."""
    gmsh.clear()
    gmsh.model.add("box")
    gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
    if beside:
        gmsh.model.occ.addRectangle(0, 0, 2, 1, 1)
    gmsh.model.occ.synchronize()

    def at(dimension, *bounds):
        return [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(*bounds, dimension)]

    gmsh.model.addPhysicalGroup(3, [1], name="box")
    top = at(2, -0.1, -0.1, 0.9, 1.1, 1.1, 2.1 if beside else 1.1)
    gmsh.model.addPhysicalGroup(2, top, name="top")
    gmsh.model.addPhysicalGroup(1, at(1, -0.1, -0.1, -0.1, 1.1, 0.1, 0.1), name="edge")
    gmsh.model.addPhysicalGroup(0, at(0, 0.9, 0.9, 0.9, 1.1, 1.1, 1.1), name="corner")
    gmsh.model.mesh.setTransfiniteAutomatic(recombine=True)
    gmsh.model.mesh.generate(3)


def test_named_groups():
    """A surface, a curve and a vertex have the points that they have in the model."""
    mesh = root_mesh_from_gmsh(MPI.COMM_WORLD, box)
    assert mesh.bodies == ("box",) and np.allclose(mesh.points[mesh.vertices["corner"]], [[1, 1, 1]])
    facets, cells = mesh.facet_points(mesh.surfaces["top"], 1).reshape(-1, 3), round(len(mesh.cells) ** (1 / 3))
    assert len(mesh.surfaces["top"]) == cells**2 > 1 and np.allclose(facets[:, 2], 1)
    cell, edge = mesh.curves["edge"].T
    ends = mesh.points[mesh.corners[cell[:, None], hexahedron.EDGE_CORNERS[edge]]]
    assert np.allclose(ends[..., 1:], 0)
    assert np.allclose(np.sort(ends[..., 0], axis=None), np.repeat(np.linspace(0, 1, cells + 1), 2)[1:-1])


def test_a_name_given_twice():
    """Gmsh drops the second one: an error, since the group would be called by its number."""

    def doubled():
        box()
        gmsh.model.addPhysicalGroup(2, [1], name="top")

    with pytest.raises(
        SceneError, match=r"physical group \d+ of dimension 2 .* has no name, beside top: .* given twice"
    ):
        root_mesh_from_gmsh(MPI.COMM_WORLD, doubled)


def test_a_surface_apart():
    """Its quadrangles are facets of no cell."""
    with pytest.raises(SceneError, match="group 'top' .* elements that belong to no cell"):
        root_mesh_from_gmsh(MPI.COMM_WORLD, lambda: box(beside=True))


def fragments():
    """Two boxes that share a face, named, with an edge and a corner of it."""
    gmsh.clear()
    occ = gmsh.model.occ
    occ.fragment([(3, occ.addBox(0, 0, 0, 1, 1, 1))], [(3, occ.addBox(0, 0, 1, 1, 1, 1))])
    occ.synchronize()
    for tag, name in enumerate(("lower", "upper"), 1):
        gmsh.model.addPhysicalGroup(3, [tag], name=name)
    flat = (-0.1, -0.1, 0.9, 1.1, 1.1, 1.1)
    gmsh.model.addPhysicalGroup(2, [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(*flat, 2)], name="face")
    edge = (-0.1, -0.1, 0.9, 1.1, 0.1, 1.1)
    gmsh.model.addPhysicalGroup(1, [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(*edge, 1)], name="edge")
    corner = (-0.1, -0.1, 0.9, 0.1, 0.1, 1.1)
    gmsh.model.addPhysicalGroup(0, [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(*corner, 0)], name="corner")
    gmsh.model.mesh.setTransfiniteAutomatic(recombine=True)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(2)


def fragments_without_names():
    """The same without physical groups."""
    fragments()
    gmsh.model.removePhysicalGroups()


def test_fragments_cut_apart():
    """Each body has its side of what they shared: face, edge and corner."""
    mesh = root_mesh_from_gmsh(MPI.COMM_WORLD, fragments, split=True)
    assert set(mesh.surfaces) == {"lower to upper", "upper to lower", "lower face", "upper face"}
    sides = [mesh.facet_points(mesh.surfaces[name]) for name in ("lower to upper", "upper to lower")]
    assert all(np.allclose(x[..., 2], 1) for x in sides) and len(sides[0]) == len(sides[1]) > 1
    assert len(mesh.vertices["corner"]) == 2 and np.allclose(mesh.points[mesh.vertices["corner"]], [0, 0, 1])
    bodies = np.zeros(len(mesh.points), dtype=int)
    bodies[mesh.cells] = mesh.body[:, None]
    assert set(bodies[mesh.nodes_of("edge")]) == set(bodies[mesh.vertices["corner"]]) == {0, 1}
    with pytest.raises(SceneError, match="share the node .* cut them apart"):
        root_mesh_from_gmsh(MPI.COMM_WORLD, fragments)


def assembly(names=("Shapes/joint/pad", "Shapes/joint/pad", "")):
    """Three boxes without physical groups, two of them side by side on the third, with the names of CAD parts."""
    gmsh.clear()
    occ = gmsh.model.occ
    for low, size in (((0, 0, 1), (1, 1, 1)), ((2, 0, 1), (1, 1, 1)), ((0, 0, 0), (3, 1, 1))):
        occ.addBox(*low, *size)
    occ.synchronize()
    for tag, name in enumerate(names, 1):
        gmsh.model.setEntityName(3, tag, name)
    gmsh.model.mesh.setTransfiniteAutomatic(recombine=True)
    gmsh.model.mesh.generate(3)


def test_an_assembly():
    """Volumes are bodies by the names of their parts, faces are surfaces, and pairs are proposed."""
    mesh = root_mesh_from_gmsh(MPI.COMM_WORLD, assembly)
    assert mesh.bodies == ("pad", "pad 2", "solid") and len(mesh.surfaces) == 18
    pairs = contacts_between(mesh, within=1e-6)
    assert {mesh.bodies[mesh.body[mesh.surface(pair.first)[0, 0]]] for pair in pairs} == {"pad", "pad 2"}
    assert len(pairs) == 2 and all(pair.second.startswith("solid face ") for pair in pairs)
    mesh = root_mesh_from_gmsh(MPI.COMM_WORLD, lambda: assembly(("plate 2", "plate", "plate")))
    assert mesh.bodies == ("plate 2", "plate", "plate 3")
    mesh = root_mesh_from_gmsh(MPI.COMM_WORLD, fragments_without_names, split=True)
    assert {"solid to solid 2", "solid 2 to solid"} < set(mesh.surfaces) and len(mesh.surfaces) == 12


def plate_and_pin():
    """A plate with a hole and a pin with play: subdivided tetrahedra, quadratic, with facets alike in the hole."""
    gmsh.clear()
    occ, mesh, hole, pin = gmsh.model.occ, gmsh.model.mesh, 1.0, 0.95
    occ.cut([(3, occ.addBox(-2, -2, 0, 4, 4, 1))], [(3, occ.addCylinder(0, 0, 0, 0, 0, 1, hole))])
    occ.addCylinder(0, 0, 0, 0, 0, 1, pin)
    occ.synchronize()
    faces = {}
    for volume, body in enumerate(("plate", "pin"), start=1):
        gmsh.model.addPhysicalGroup(3, [volume], name=body)
        around = gmsh.model.getBoundary([(3, volume)], oriented=False)
        faces[body] = [face for dim, face in around if gmsh.model.getType(dim, face) == "Cylinder"]
        gmsh.model.addPhysicalGroup(2, faces[body], name=f"{body} round")
    mesh.setPeriodic(2, faces["pin"], faces["plate"], np.diag([pin, pin, 1, 1]).ravel())
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.7)
    gmsh.option.setNumber("Mesh.Algorithm3D", 10)
    mesh.generate(3)
    gmsh.option.setNumber("Mesh.SubdivisionAlgorithm", 2)
    mesh.refine()
    mesh.setPeriodic(2, faces["pin"], faces["pin"], np.eye(4).ravel())
    mesh.setOrder(2)


def test_subdivided_tetrahedra():
    """All nodes of round sides are on the surfaces of the model, and facets that Gmsh copied face each other."""
    mesh = root_mesh_from_gmsh(MPI.COMM_WORLD, plate_and_pin)
    assert mesh.order == 2 and mesh.bodies == ("plate", "pin")
    for side, radius in (("plate round", 1.0), ("pin round", 0.95)):
        nodes = mesh.facet_points(mesh.surface(side)).reshape(-1, 3)
        assert np.allclose(np.hypot(nodes[:, 0], nodes[:, 1]), radius, atol=1e-12)
    pairing = Pairing(mesh, (ContactPair("plate round", "pin round"),))
    assert pairing.paired.sum() == 2 * len(mesh.surface("pin round")) > 40
