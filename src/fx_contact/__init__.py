"""Adaptive 3D contact mechanics on FEniCSx: elastic bodies pressed together to a prescribed accuracy, in parallel."""

from fx_contact.adapt import adapt
from fx_contact.enforcement import Enforcement
from fx_contact.scene import ContactPair, Dirichlet, Material, Scene, Traction
from fx_contact.krylov import Solver

__all__ = ["ContactPair", "Dirichlet", "Enforcement", "Material", "Scene", "Solver", "Traction", "adapt"]
