"""Root meshes of Gmsh: named groups of all dimensions at their place, elements that belong to no cell."""

import numpy as np
import pytest
from mpi4py import MPI

from fx_contact import SceneError
from fx_contact.problem import hexahedron
from fx_contact.problem.gmsh_mesh import root_mesh_from_gmsh

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


def test_a_surface_apart():
    """Its quadrangles are facets of no cell."""
    with pytest.raises(SceneError, match="group 'top' .* elements that belong to no cell"):
        root_mesh_from_gmsh(MPI.COMM_WORLD, lambda: box(beside=True))
