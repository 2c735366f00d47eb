"""Root mesh: shapes, readers, lattice keys, facets and points on them."""
