"""Problem description: root mesh, shapes, lattice keys, facet pairing, materials, conditions, contact pairs."""

from fx_contact.problem.boundary_conditions import (
    BodyForce,
    Dirichlet,
    Pressure,
    RigidMotion,
    SymmetryPlane,
    Traction,
)
from fx_contact.problem.contact import Contact, ContactPair
from fx_contact.problem.elastic_support import Elastic
from fx_contact.problem.gmsh_mesh import root_mesh_from_file, root_mesh_from_gmsh
from fx_contact.problem.materials import Material, Orthotropic
from fx_contact.problem.obstacles import Obstacle, RigidCone, RigidCylinder, RigidPlane, RigidSphere, RigidSurface
from fx_contact.problem.rigid_loads import RigidLoad
from fx_contact.problem.root_mesh import RootMesh
from fx_contact.problem.scene import Scene
from fx_contact.problem.shapes import Shape, join, root_mesh_from_shapes
from fx_contact.problem.solids import ball, block, cylinder, ring
from fx_contact.problem.stress_free_strains import InitialStrain, ThermalStrain
from fx_contact.problem.swept_shapes import extrude, revolve, sweep_side
from fx_contact.problem.ties import Preload, Tie

__all__ = [
    "BodyForce",
    "Contact",
    "ContactPair",
    "Dirichlet",
    "InitialStrain",
    "Elastic",
    "Material",
    "Obstacle",
    "Orthotropic",
    "Preload",
    "Pressure",
    "RigidCone",
    "RigidCylinder",
    "RigidMotion",
    "RigidLoad",
    "RigidPlane",
    "RigidSphere",
    "RigidSurface",
    "RootMesh",
    "Scene",
    "Shape",
    "SymmetryPlane",
    "ThermalStrain",
    "Tie",
    "Traction",
    "ball",
    "block",
    "cylinder",
    "extrude",
    "join",
    "revolve",
    "ring",
    "root_mesh_from_file",
    "root_mesh_from_gmsh",
    "root_mesh_from_shapes",
    "sweep_side",
]
