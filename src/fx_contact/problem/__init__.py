"""What is to be solved: root mesh, lattice keys, facing facets, materials, conditions, contact pairs."""

from fx_contact.problem.boundary_conditions import BodyForce, Dirichlet, Pressure, SymmetryPlane, Traction
from fx_contact.problem.gmsh_mesh import root_mesh_from_file, root_mesh_from_gmsh
from fx_contact.problem.materials import Material
from fx_contact.problem.root_mesh import RootMesh
from fx_contact.problem.scene import ContactPair, Scene

__all__ = [
    "BodyForce",
    "ContactPair",
    "Dirichlet",
    "Material",
    "Pressure",
    "RootMesh",
    "Scene",
    "SymmetryPlane",
    "Traction",
    "root_mesh_from_file",
    "root_mesh_from_gmsh",
]
