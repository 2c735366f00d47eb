"""The level of degree 1 below a matrix of degree 2, on the same leaves: the coarse level of p-multigrid.

Conforming functions of degree 1 are conforming functions of degree 2, on hanging nodes and curved cells too.  So the
interpolation I takes the values of the former at the conforming nodes of the latter, and the coarse matrix is I^T K I,
here assembled at degree 1.  The idea: E. M. Ronquist, A. T. Patera, J. Sci. Comput. 2(4), 1987.
"""

import numpy as np
from petsc4py import PETSc
from scipy.sparse import csr_matrix, diags, identity, kron

from fx_contact.fem.flat_cells import strong_blocks
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.linalg.matrix import distributed
from fx_contact.linalg.p_multigrid import CoarseLevel
from fx_contact.problem import hexahedron


def create_coarse_level(elasticity, prescribed):
    """The level of degree 1 of an elasticity of degree 2.

    Collective.

    Args:
        elasticity: Elasticity.
        prescribed: (owned, 3) float64, prescribed displacements, NaN where free [m].

    Returns:
        CoarseLevel.
    """
    fine = elasticity.prolongation
    coarse = Prolongation(Space(fine.space.forest, 1))
    place = coarse.injected(fine.find(coarse.space.keys))
    free = fine.ghosted(np.isnan(prescribed).astype(float))[place] > 0

    matrix = elasticity.on(coarse).stiffness(mixed=elasticity.mixed).mat
    matrix.assemble()
    diagonal = matrix.getDiagonal()
    fixed = matrix.getOwnershipRange()[0] + np.flatnonzero(~free.ravel()).astype(PETSc.IntType)
    matrix.zeroRowsColumns(fixed, diag=diagonal.sum() / diagonal.getSize())
    diagonal.destroy()
    matrix.convert(PETSc.Mat.Type.AIJ)
    return CoarseLevel(matrix, _interpolation(fine, coarse, free), strong_blocks(elasticity))


def _interpolation(fine, coarse, free):
    """I from the coarse unknowns, those that are not free left out: PETSc AIJ."""
    leaf, node = fine.injected(fine.space.example).T
    corners = hexahedron.lagrange(1, np.linspace(0, 1, fine.space.degree + 1))
    weights = np.kron(corners, np.kron(corners, corners))[node]
    nodes = coarse.space.cells[leaf]
    values = csr_matrix(
        (weights.ravel(), nodes.ravel(), np.arange(0, weights.size + 1, 8)), shape=(fine.owned, len(coarse.space))
    )
    values.eliminate_zeros()
    mask = coarse.ghosted(free.astype(float)).ravel()
    matrix = kron(values @ coarse.matrix, identity(3), format="csr") @ diags(mask)
    matrix.eliminate_zeros()
    return distributed(fine.comm, matrix, coarse.index_map)
