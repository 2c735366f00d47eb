"""Adaptive 3D contact mechanics on FEniCSx: elastic bodies pressed together to a prescribed accuracy, in parallel."""

from fx_contact.adapt import adapt
from fx_contact.enforcement import Enforcement
from fx_contact.solver import Solver
from fx_contact.prescriptions import BodyForce, Dirichlet, Pressure, SymmetryPlane, Traction
from fx_contact.scene import ContactPair, Material, Scene

__all__ = [
    "BodyForce",
    "ContactPair",
    "Dirichlet",
    "Enforcement",
    "Material",
    "Pressure",
    "Scene",
    "Solver",
    "SymmetryPlane",
    "Traction",
    "adapt",
]
