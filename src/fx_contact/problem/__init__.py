"""What is to be solved: root mesh, lattice keys, facing facets, materials, conditions, contact pairs."""
