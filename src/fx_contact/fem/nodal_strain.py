"""Stress-free strains and body forces of a scene at the nodes of each cell."""

from collections.abc import Sequence

import numpy as np

from fx_contact.fem.leaf_mesh import LeafMesh
from fx_contact.fem.space import Space
from fx_contact.items.boundary_conditions import BodyForce
from fx_contact.items.stress_free_strains import InitialStrain, ThermalStrain
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.mpi import together
from fx_contact.scene.scene import Scene


def stress_free_strain(scene: Scene, space: Space, mesh: LeafMesh) -> FloatArray | None:
    """Sum of the strains that act on each cell at its nodes in `Space.cells`: (ncells, (p+1)^3, 3, 3) [-].

    Collective on the mesh's communicator.  None: the scene has none.  Raises SceneError if a strain that is a function
    fails, is not finite or not symmetric somewhere.
    """
    if not scene.strains:
        return None
    return sum_at_nodes(scene.strains, space, mesh, (3, 3))


def sum_at_nodes(
    items: Sequence[BodyForce | ThermalStrain | InitialStrain], space: Space, mesh: LeafMesh, shape: tuple[int, ...]
) -> FloatArray:
    """Sum of what acts on each cell at its nodes in `Space.cells`: (ncells, (p+1)^3, *shape).

    Collective on the mesh's communicator.  Raises SceneError as `stress_free_strain`.
    """
    nodes, root = space.cells[mesh.leaf], space.forest.cell[mesh.leaf]
    result: FloatArray = np.zeros((*nodes.shape, *shape))
    with together(space.forest.comm):
        for item in items:
            cells, nodal = np.isin(root, space.forest.mesh.cells_of(item.place)), np.zeros((len(space), *shape))
            on = np.isin(np.arange(len(space)), nodes[cells])
            nodal[on] = item.at(space.positions(on))
            result[cells] += nodal[nodes[cells]]
    return result
