"""Root meshes as meshes of dolfinx with tags."""

import basix
import basix.ufl
import numpy as np
from basix import CellType, LagrangeVariant
from conftest import WORLD
from dolfinx import mesh as dolfinx_mesh


def tagged(mesh, dimension, entities, values):
    """MeshTags of entities in ascending order, with a value each or one for all."""
    entities = np.asarray(entities, dtype=np.int32)
    values = np.broadcast_to(np.asarray(values, dtype=np.int32), entities.shape)
    return dolfinx_mesh.meshtags(mesh, dimension, entities, values.copy())


def of_dolfinx(root, variant=LagrangeVariant.equispaced):
    """A root mesh as a distributed dolfinx mesh with tags: the arguments of `RootMesh.from_dolfinx`."""
    order, share = root.order, lambda rows: np.array_split(rows, WORLD.size)[WORLD.rank]
    basis = basix.create_element(basix.ElementFamily.P, CellType.hexahedron, order, variant)
    along = np.unique(np.round(basis.points[:, 0], 12))
    tensor = np.searchsorted(along, np.round(basis.points, 12)) @ [1, order + 1, (order + 1) ** 2]
    x = root.points.copy()
    x[root.cells] = root.evaluate(np.arange(len(root.cells)), np.broadcast_to(along, (len(root.cells), 3, order + 1)))
    element = basix.ufl.element("Lagrange", "hexahedron", order, lagrange_variant=variant, shape=(3,))
    mesh = dolfinx_mesh.create_mesh(WORLD, cells=share(root.cells)[:, tensor], e=element, x=share(x))
    numbers = mesh.topology.original_cell_index
    cell_tags = tagged(mesh, 3, np.arange(len(numbers)), 7 + root.body[numbers])
    mesh.topology.create_entities(2)
    mesh.topology.create_connectivity(3, 2)
    facets = mesh.topology.connectivity(3, 2).array.reshape(-1, 6)
    value = np.zeros((len(root.cells), 6), dtype=np.int32)
    for tag, rows in enumerate(root.surfaces.values(), 1):
        value[rows[:, 0], rows[:, 1]] = tag
    cell, face = np.nonzero(value[numbers])
    at = dict(zip(facets[cell, face].tolist(), value[numbers[cell], face].tolist()))
    facet_tags = tagged(mesh, 2, sorted(at), [at[i] for i in sorted(at)])
    bodies = {7 + index: name for index, name in enumerate(root.bodies)}
    return mesh, cell_tags, facet_tags, bodies, dict(enumerate(root.surfaces, 1))
