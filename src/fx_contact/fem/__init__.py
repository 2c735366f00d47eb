"""Finite elements on the leaves: nodes and hanging constraints, dolfinx meshes, stiffness, conditions and loads."""

from fx_contact.fem.elasticity import Elasticity
from fx_contact.fem.leaf_mesh import LeafMesh, create_leaf_mesh
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space

__all__ = ["Elasticity", "LeafMesh", "Prolongation", "Space", "create_leaf_mesh"]
