"""Adaptive 3D contact mechanics on FEniCSx: elastic bodies pressed together to a prescribed accuracy, in parallel."""

from fx_contact.adaptive.adaptive_loop import adapt
from fx_contact.contact.enforcement import Enforcement
from fx_contact.estimate.error_control import ErrorControl
from fx_contact.linalg.solver_options import Solver
from fx_contact.problem.boundary_conditions import BodyForce, Dirichlet, Pressure, SymmetryPlane, Traction
from fx_contact.problem.materials import Material
from fx_contact.problem.scene import ContactPair, Scene

__all__ = [
    "BodyForce",
    "ContactPair",
    "Dirichlet",
    "Enforcement",
    "ErrorControl",
    "Material",
    "Pressure",
    "Scene",
    "Solver",
    "SymmetryPlane",
    "Traction",
    "adapt",
]
