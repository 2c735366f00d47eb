"""Contact of bodies of revolution by finite elements in the half plane (r, z): references for studies and tests.

Nodes have an active set around a direct solver.  No part of it is the package's.
"""

import gmsh
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import assemble_matrix
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import bmat, csr_matrix

try:
    from dolfinx.io import gmshio as gmsh_models
except ImportError:  # since 0.10
    from dolfinx.io import gmsh as gmsh_models


def triangles(plane, order):
    """A mesh of the surface whose tag `plane` gives, once it has made it in an empty model of Gmsh with its sizes."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    try:
        gmsh.model.addPhysicalGroup(2, [plane()], 1)
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(order)
        return gmsh_models.model_to_mesh(gmsh.model, MPI.COMM_SELF, 0, gdim=2)[0]
    finally:
        gmsh.finalize()


def lame(young, poisson):
    """Shear modulus and first parameter."""
    return young / (2 * (1 + poisson)), young * poisson / ((1 + poisson) * (1 - 2 * poisson))


def strain(u, r):
    """Strain (3, 3) of a displacement (u_r, u_z), along r, z and around the axis."""
    plane = ufl.sym(ufl.grad(u))
    return ufl.as_tensor([[plane[0, 0], plane[0, 1], 0], [plane[1, 0], plane[1, 1], 0], [0, 0, u[0] / r]])


def assembled(work, r):
    """The matrix of a form per volume, of the whole body: scipy CSR."""
    matrix = assemble_matrix(fem.form(2 * np.pi * r * work * ufl.dx(degree=6)))
    matrix.assemble()
    return csr_matrix(matrix.getValuesCSR()[::-1], shape=matrix.getSize())


def stiffness(space, shear, first):
    """The stiffness of a space of displacements with Lame's parameters: scipy CSR."""
    u, v, r = ufl.TrialFunction(space), ufl.TestFunction(space), ufl.SpatialCoordinate(space.mesh)[0]
    stress = first * ufl.tr(strain(u, r)) * ufl.Identity(3) + 2 * shear * strain(u, r)
    return assembled(ufl.inner(stress, strain(v, r)), r)


def pressed(matrix, held, closing, gap, closed, values=0.0, load=0.0):
    """The solution u (n,) with closing u <= gap, and the forces (m,) of the rows.

    Args:
        matrix: (n, n), may be singular where contact alone holds.
        held: (n,) bool, dofs with the given `values`.
        closing: (m, n) sparse, gap: (m,).
        closed: (m,) bool, rows that are closed at first.
        load: (n,) or a number.

    Raises:
        RuntimeError: the active set does not settle.
    """
    free, known = np.flatnonzero(~held), np.where(held, values, 0.0)
    inner, load = matrix[free][:, free], load - matrix @ known
    for _ in range(50):
        rows = closing[closed]
        right = np.concatenate([load[free], gap[closed] - rows @ known])
        u, force, rows = known.copy(), np.zeros(len(gap)), rows[:, free]
        u[free], force[closed] = np.split(_solved(bmat([[inner, rows.T], [rows, None]]), right), [len(free)])
        wanted = np.where(closed, force > 0, closing @ u > gap)
        if (wanted == closed).all():
            return u, force
        closed = wanted
    raise RuntimeError("the active set does not settle")


def _solved(matrix, right):
    """By MUMPS: factors of SuperLU give forces that are off by 1e-4, where stiffnesses are large beside the rows' 1."""
    matrix = matrix.tocsr()
    mat = PETSc.Mat().createAIJ(matrix.shape, csr=(matrix.indptr, matrix.indices, matrix.data), comm=MPI.COMM_SELF)
    ksp = PETSc.KSP().create(MPI.COMM_SELF)
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    ksp.getPC().setFactorSolverType("mumps")
    ksp.setOperators(mat)
    x, b = mat.createVecs()
    b.array[:] = right
    ksp.solve(b, x)
    return x.array.copy()
