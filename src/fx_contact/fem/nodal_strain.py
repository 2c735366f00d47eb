"""The stress-free strain of a scene at the nodes of each cell."""

import numpy as np

from fx_contact.fem.leaf_mesh import LeafMesh
from fx_contact.fem.space import Space
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
    nodes, root = space.cells[mesh.leaf], space.forest.cell[mesh.leaf]
    result: FloatArray = np.zeros((*nodes.shape, 3, 3))
    with together(space.forest.comm):
        for strain in scene.strains:
            cells, nodal = np.isin(root, scene.mesh.cells_of(strain.part)), np.zeros((len(space), 3, 3))
            on = np.isin(np.arange(len(space)), nodes[cells])
            nodal[on] = strain.at(space.positions(on))
            result[cells] += nodal[nodes[cells]]
    return result
