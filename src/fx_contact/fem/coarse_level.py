"""The level of degree 1 below a matrix of degree 2, on the same leaves: the coarse level of p-multigrid.

Conforming functions of degree 1 are conforming functions of degree 2, on hanging nodes and curved cells too.  So the
interpolation I takes the values of the former at the conforming nodes of the latter, and the coarse matrix is I^T K I,
here assembled at degree 1.  Source: E. M. Ronquist, A. T. Patera, J. Sci. Comput. 2(4), 1987.
"""

import numpy as np
from petsc4py import PETSc
from scipy.sparse import csr_matrix, identity, kron

from fx_contact.fem.elasticity import Elasticity
from fx_contact.fem.flat_cells import strong_blocks
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.fem.supports import Supports
from fx_contact.linalg.matrix import distributed
from fx_contact.linalg.p_multigrid import CoarseLevel
from fx_contact.problem import hexahedron


def create_coarse_level(elasticity: Elasticity, supports: Supports) -> CoarseLevel:
    """The level of degree 1 of an elasticity of degree 2, with supports at its owned conforming nodes.  Collective."""
    fine = elasticity.prolongation
    coarse = Prolongation(Space(fine.space.forest, 1))
    place = coarse.injected(fine.find(coarse.space.keys))
    below = supports.ghosted(fine).at(place).in_frames()

    matrix = elasticity.on(coarse).stiffness(mixed=elasticity.mixed, supports=below).mat
    matrix.assemble()
    diagonal = matrix.getDiagonal()
    fixed = matrix.getOwnershipRange()[0] + np.flatnonzero(~below.free.ravel()).astype(PETSc.IntType)
    matrix.zeroRowsColumns(fixed, diag=diagonal.sum() / diagonal.getSize())
    diagonal.destroy()
    matrix.convert(PETSc.Mat.Type.AIJ)
    return CoarseLevel(matrix, _interpolation(fine, coarse, below), strong_blocks(elasticity))


def _interpolation(fine: Prolongation, coarse: Prolongation, below: Supports) -> PETSc.Mat:
    """I from the coarse unknowns that supports leave free: AIJ."""
    leaf, node = fine.injected(fine.space.example).T
    corners = hexahedron.lagrange(1, np.linspace(0, 1, fine.space.degree + 1))
    weights = np.kron(corners, np.kron(corners, corners))[node]
    nodes = coarse.space.cells[leaf]
    values = csr_matrix(
        (weights.ravel(), nodes.ravel(), np.arange(0, weights.size + 1, 8)), shape=(fine.owned, len(coarse.space))
    )
    values.eliminate_zeros()
    matrix = kron(values @ coarse.matrix, identity(3), format="csr") @ below.ghosted(coarse).projector()
    matrix.eliminate_zeros()
    return distributed(fine.comm, matrix, coarse.index_map)
