"""Adaptive 3D contact mechanics on FEniCSx: elastic bodies pressed together to a prescribed accuracy, in parallel."""

from fx_contact.adaptive.adaptive_loop import adapt
from fx_contact.adaptive.beginning import Beginning
from fx_contact.adaptive.checkpoint import Checkpoint
from fx_contact.adaptive.solving import solve
from fx_contact.adaptive.step import Step
from fx_contact.adaptive.step_record import StepRecord
from fx_contact.contact.enforcement import Enforcement
from fx_contact.estimate.contact_quantities import ContactForce, FrictionForce, Gap, MaxPressure
from fx_contact.estimate.error_control import ErrorControl
from fx_contact.estimate.quantities import Displacement, Reaction
from fx_contact.geometry.gmsh_mesh import root_mesh_from_file, root_mesh_from_gmsh
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.geometry.shapes import Shape, join, root_mesh_from_shapes
from fx_contact.geometry.solids import ball, block, cylinder, ring
from fx_contact.geometry.swept_shapes import extrude, revolve, sweep_side
from fx_contact.items.boundary_conditions import BodyForce, Dirichlet, Pressure, RigidMotion, SymmetryPlane, Traction
from fx_contact.items.contact import ContactPair
from fx_contact.items.elastic_support import Elastic
from fx_contact.items.friction import Tresca
from fx_contact.items.materials import Material, Orthotropic
from fx_contact.items.obstacles import RigidCone, RigidCylinder, RigidPlane, RigidSphere, RigidSurface
from fx_contact.items.rigid_loads import RigidLoad
from fx_contact.items.stress_free_strains import InitialStrain, ThermalStrain
from fx_contact.items.ties import Preload, Tie
from fx_contact.linalg.solver_options import Solver
from fx_contact.parallel.errors import (
    CheckpointError,
    FxContactError,
    GeometryError,
    OutputError,
    SceneError,
    SolveError,
    ValidityError,
)
from fx_contact.parallel.meeting import expect_end
from fx_contact.path.load_path import increments, sweep
from fx_contact.scene.scene import Scene
from fx_contact.surfaces.proposals import contacts_between

__version__ = "0.2.0"

__all__ = [
    "Beginning",
    "BodyForce",
    "Checkpoint",
    "CheckpointError",
    "ContactForce",
    "ContactPair",
    "Dirichlet",
    "Displacement",
    "Elastic",
    "Enforcement",
    "ErrorControl",
    "FrictionForce",
    "FxContactError",
    "Gap",
    "GeometryError",
    "InitialStrain",
    "Material",
    "MaxPressure",
    "Orthotropic",
    "OutputError",
    "Preload",
    "Pressure",
    "Reaction",
    "RigidCone",
    "RigidCylinder",
    "RigidMotion",
    "RigidLoad",
    "RigidPlane",
    "RigidSphere",
    "RigidSurface",
    "RootMesh",
    "Scene",
    "SceneError",
    "Shape",
    "SolveError",
    "Solver",
    "Step",
    "StepRecord",
    "SymmetryPlane",
    "ThermalStrain",
    "Tie",
    "Traction",
    "Tresca",
    "ValidityError",
    "adapt",
    "ball",
    "block",
    "contacts_between",
    "cylinder",
    "extrude",
    "increments",
    "join",
    "revolve",
    "ring",
    "root_mesh_from_file",
    "root_mesh_from_gmsh",
    "root_mesh_from_shapes",
    "solve",
    "sweep",
    "sweep_side",
]

expect_end()
