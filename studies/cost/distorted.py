"""Distorted cells at degree 2: tetrahedra of a CAD model that Gmsh subdivides into hexahedra, four each.

    python3 -m studies.cost.distorted
"""

import gmsh
import numpy as np
from mpi4py import MPI

from fx_contact import Dirichlet, Material, Scene, Traction, root_mesh_from_gmsh


def subdivided(size):
    """Mesh the current model of OpenCASCADE with hexahedra: four of each tetrahedron of a size."""
    gmsh.option.setNumber("Mesh.MeshSizeMin", size)
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.model.mesh.generate(3)
    gmsh.option.setNumber("Mesh.SubdivisionAlgorithm", 2)
    gmsh.model.mesh.refine()


def named(held, loaded):
    """Physical groups of the only volume and of its surfaces in two boxes."""
    gmsh.model.occ.synchronize()
    (volume,) = gmsh.model.getEntities(3)
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [volume[1]]), "part")
    for name, box in (("held", held), ("loaded", loaded)):
        found = [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(*box, dim=2)]
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, found), name)


def bracket(size):
    """An angle of two legs of 80 x 60 x 10 mm, rounded inside, with a hole in the upright one."""
    cad, eps = gmsh.model.occ, 1e-3
    legs = [(3, cad.addBox(0, 0, 0, 80, 60, 10)), (3, cad.addBox(0, 0, 0, 10, 60, 80))]
    fillet = cad.cut([(3, cad.addBox(10, 0, 10, 10, 60, 10))], [(3, cad.addCylinder(20, 0, 20, 0, 60, 0, 10))])[0]
    part = cad.fuse(legs[:1], [*legs[1:], *fillet])[0]
    cad.cut(part, [(3, cad.addCylinder(-5, 30, 50, 20, 0, 0, 10))])
    named((-eps, -eps, -eps, 80 + eps, 60 + eps, eps), (-eps, 20 - eps, 40 - eps, 10 + eps, 40 + eps, 60 + eps))
    subdivided(size)


def cube(size):
    """A cube of 60 mm, held below."""
    eps = 1e-3
    gmsh.model.occ.addBox(0, 0, 0, 60, 60, 60)
    named((-eps, -eps, -eps, 60 + eps, 60 + eps, eps), (-eps, -eps, 60 - eps, 60 + eps, 60 + eps, 60 + eps))
    subdivided(size)


def scene(build, size, poisson=0.3):
    """A part of steel, held on one side and pulled on another [mm, MPa]."""
    mesh = root_mesh_from_gmsh(MPI.COMM_WORLD, lambda: build(size))
    conditions = (Dirichlet("held", 0.0, 0.0, 0.0),)
    return Scene("part", mesh, {"part": Material(210e3, poisson)}, conditions, (), (Traction("loaded", (1.0, 0.0, -1.0)),))
