"""Stress-free strains and body forces of a scene at the nodes of each cell."""

from collections.abc import Sequence

import numpy as np

from fx_contact.fem.leaf_mesh import LeafMesh
from fx_contact.fem.space import Space
from fx_contact.items.boundary_conditions import BodyForce
from fx_contact.items.stress_free_strains import InitialStrain, ThermalStrain
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.mpi import together


def sum_at_nodes(
    items: Sequence[BodyForce | ThermalStrain | InitialStrain], space: Space, mesh: LeafMesh, shape: tuple[int, ...]
) -> FloatArray:
    """Sum of what acts on each cell at its nodes in `Space.cells`: (ncells, (p+1)^3, *shape).

    Collective on the mesh's communicator.  Raises SceneError if what is a function fails, or is not finite, or a strain
    not symmetric, somewhere.
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
