"""Lagrange spaces of dolfinx on a leaf mesh, and the nodes of the Space that their blocks have."""

import basix.ufl
import numpy as np
from basix import CellType
from dolfinx import fem
from scipy.sparse import csr_matrix

from fx_contact.fem.leaf_mesh import LeafMesh, basix_order
from fx_contact.fem.prolongation import Prolongation
from fx_contact.parallel.arrays import FloatArray, Int32Array, Int64Array


class NodalSpaces:
    """Functions of degree p with values at nodes.

    Collective on mesh.comm.

    Attributes:
        function_space: of displacements, a block of 3 a node.
        cells: (ncells, (p+1)^3), nodes in the Space of each local cell.
        node_of_block: (nblocks,), the node of each local block of `function_space`; several blocks may have one.
        order: ((p+1)^3,), node in `cells` of each node of a cell of `function_space`.
        gather: (m, nblocks), sums of values of the local blocks at the nodes.
    """

    def __init__(self, leaf_mesh: LeafMesh, prolongation: Prolongation) -> None:
        self.leaf_mesh, self.mesh, self.prolongation = leaf_mesh, leaf_mesh.mesh, prolongation
        self._spaces: dict[tuple[tuple[int, ...], bool], fem.FunctionSpace] = {}
        self.function_space = self.space_of(3)
        imap = self.function_space.dofmap.index_map
        self.cells: Int32Array = prolongation.space.cells[leaf_mesh.leaf]
        self.node_of_block: Int64Array = np.empty(imap.size_local + imap.num_ghosts, dtype=np.int64)
        self.order = basix_order(CellType.hexahedron, prolongation.space.degree)
        self.node_of_block[self.function_space.dofmap.list] = self.cells[:, self.order]
        count = len(self.node_of_block)
        entries = np.ones(count), (self.node_of_block, np.arange(count))
        self.gather = csr_matrix(entries, shape=(len(prolongation.space), count))

    def space_of(self, *shape: int, discontinuous: bool = False) -> fem.FunctionSpace:
        """Functions of the displacement's degree with components of a shape, made once.  Collective."""
        if (shape, discontinuous) not in self._spaces:
            degree = self.prolongation.space.degree
            element = basix.ufl.element("Lagrange", "hexahedron", degree, shape=shape, discontinuous=discontinuous)
            self._spaces[shape, discontinuous] = fem.functionspace(self.mesh, element)
        return self._spaces[shape, discontinuous]

    def of_cells(self, values: FloatArray) -> fem.Function:
        """The discontinuous Function with values (ncells, (p+1)^3, ...) at the nodes of `cells`.  Collective."""
        shape = values.shape[2:]
        function = fem.Function(self.space_of(*shape, discontinuous=True))
        function.x.array.reshape(-1, *shape)[function.function_space.dofmap.list] = values[:, self.order]
        return function

    def at_blocks(self, values: FloatArray) -> FloatArray:
        """Array (nblocks * k,) of a Function of a nodal space, of values (m, k) at all nodes.  Local."""
        return values[self.node_of_block].ravel()

    def at_nodes(self, blocks: FloatArray) -> FloatArray:
        """Contributions (m, k) of this rank's cells to the nodes, of an assembled vector (nblocks * k,).  Local."""
        return self.gather @ blocks.reshape(len(self.node_of_block), -1)

    def at_leaves(self, function: fem.Function) -> FloatArray:
        """Nodal values of a Function of a nodal space or of a discontinuous one by leaves: (n, (p+1)^3, k).  Local."""
        space = function.function_space
        values = function.x.array.reshape(-1, space.dofmap.bs)[space.dofmap.list]
        result = np.empty_like(values)
        result[self.leaf_mesh.leaf[:, None], self.order] = values
        return result
