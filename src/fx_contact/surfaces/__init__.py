"""Contact surfaces: facets that face each other, on matching meshes and others."""
