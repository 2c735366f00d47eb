"""The level of degree 1 below a matrix of degree 2, on the same leaves: the coarse level of p-multigrid.

Conforming functions of degree 1 are conforming functions of degree 2, on hanging nodes and curved cells too.  So the
interpolation I takes the values of the former at the conforming nodes of the latter, and the coarse matrix is I^T K I,
here assembled at degree 1.  Source: E. M. Ronquist, A. T. Patera, J. Sci. Comput. 2(4), 1987.

A cell of the sides h_x, h_y, h_z couples its nodes along x by about 1 / h_x^2.  With a block smoother for the nodes
along the short axes of flat cells the number of iterations is that on cubes (W. Hackbusch, Multi-Grid Methods and
Applications, 1985, section 10.1).
"""

import numpy as np
from petsc4py import PETSc
from scipy.sparse import coo_matrix, csr_matrix, identity, kron
from scipy.sparse.csgraph import connected_components

from fx_contact.fem.elasticity import Elasticity
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.fem.supports import Supports
from fx_contact.geometry import hexahedron
from fx_contact.linalg.matrix import distributed
from fx_contact.linalg.p_multigrid import CoarseLevel
from fx_contact.parallel.arrays import Int64Array
from fx_contact.parallel.mpi import any_true, hashed

#: An axis of a cell is short if the longest axis has at least this many times its length (`studies.cost.flat`).
FLAT = 3.0


def create_coarse_level(elasticity: Elasticity, supports: Supports) -> CoarseLevel:
    """The level of degree 1 of an elasticity of degree 2, with supports at its owned conforming nodes.  Collective."""
    fine = elasticity.prolongation
    coarse = Prolongation(Space(fine.space.forest, 1))
    place = coarse.injected(fine.find(coarse.space.keys))
    below = supports.ghosted(fine).at(place).in_frames()

    matrix = elasticity.on(coarse).stiffness(mixed=elasticity.mixed, supports=below).mat
    matrix.assemble()
    diagonal = matrix.getDiagonal()
    diagonal.array[~below.free.ravel()] = diagonal.sum() / diagonal.getSize()
    matrix.setDiagonal(diagonal)
    diagonal.destroy()
    matrix.convert(PETSc.Mat.Type.AIJ)
    return CoarseLevel(matrix, _interpolation(fine, coarse, below), strong_blocks(elasticity))


def _interpolation(fine: Prolongation, coarse: Prolongation, below: Supports) -> PETSc.Mat:
    """I from the coarse unknowns that supports leave free: AIJ."""
    leaf, node = fine.injected(fine.space.example).T
    corners = hexahedron.lagrange(1, np.linspace(0, 1, fine.space.degree + 1))
    weights = np.kron(corners, np.kron(corners, corners))[node]
    nodes = coarse.space.cells[leaf]
    entries = weights.ravel(), nodes.ravel(), np.arange(0, weights.size + 1, 8)
    values = csr_matrix(entries, shape=(fine.owned, len(coarse.space)))
    values.eliminate_zeros()
    matrix = kron(values @ coarse.matrix, identity(3), format="csr") @ below.ghosted(coarse).projector()
    matrix.eliminate_zeros()
    return distributed(fine.comm, matrix, coarse.index_map)


def strong_blocks(elasticity: Elasticity) -> Int64Array | None:
    """Blocks of the conforming nodes: those on a line along the short axes of flat cells, from cell to cell.

    Collective.  A block may have nodes of several ranks; None: no cell of any rank is flat.

    Returns:
        (owned,), block of each owned node: a random number.  Its remainder by comm.size is the rank that solves for
        the block, the owner of one of its nodes.
    """
    prolongation, leaf_mesh = elasticity.prolongation, elasticity.leaf_mesh
    space, comm = prolongation.space, prolongation.comm
    leaf, corner = np.repeat(np.arange(len(space.cells)), 8), np.tile(np.arange(8), len(space.cells))
    lengths = hexahedron.lengths(leaf_mesh.positions(leaf, corner, 1).reshape(-1, 8, 3))
    short = FLAT * lengths <= lengths.max(axis=1, keepdims=True)
    if not any_true(comm, short):
        return None
    side = space.degree + 1
    nodes = space.cells.reshape(-1, side, side, side)
    neighbours = []
    for axis in range(3):
        line = np.moveaxis(nodes[short[:, axis]], 3 - axis, 1)
        neighbours.append(np.stack([line[:, :-1].ravel(), line[:, 1:].ravel()]))
    links = np.concatenate(neighbours, axis=1)
    links = links[:, ~prolongation.hanging[links].any(axis=0)]
    graph = coo_matrix((np.ones(links.shape[1], dtype=bool), links), shape=(len(space),) * 2)
    count, piece = connected_components(graph, directed=False)

    imap, own = prolongation.index_map, prolongation.conforming >= 0
    owner = np.concatenate([np.full(imap.size_local, comm.rank), imap.owners])
    # Blocks with the same number would be solved for as one, which is correct too.
    draw = hashed(prolongation.numbers.astype(np.int64), np.iinfo(np.int32).max).astype(np.int64) * comm.size + owner
    block: Int64Array = np.full(len(space), np.iinfo(np.int64).max)
    block[own] = draw[prolongation.conforming[own]]
    while True:  # once for each piece of a line that is cut by ranks, and once more
        lowest = np.full(count, np.iinfo(np.int64).max)
        np.minimum.at(lowest, piece, block)
        before, block = block, space.directory.lowest(lowest[piece])
        if not any_true(comm, block != before):
            return prolongation.injected(block)
