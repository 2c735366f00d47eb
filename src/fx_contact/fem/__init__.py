"""Finite elements on the leaves: nodes and hanging constraints, dolfinx meshes, stiffness, conditions and loads."""
