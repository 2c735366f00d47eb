"""How far a displacement is from a known one: energy and L2 norms of the difference, cell by cell."""

from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

from fx_contact.elasticity import QUADRATURE_DEGREE

#: Degree of the Gauss rule where a smooth function that is no polynomial is integrated.
FINE_QUADRATURE = 6


@dataclass(frozen=True)
class FieldError:
    """Difference of two displacements relative to the known one.

    Attributes:
        energy: in the energy norm [-].
        l2: in the L2 norm [-].
    """

    energy: float
    l2: float


def field_error(elasticity, exact):
    """Distance of `elasticity.u` from a known displacement.

    Collective.

    Args:
        elasticity: Elasticity, its `u` set.
        exact: UFL vector on its mesh [m].

    Returns:
        FieldError.
    """
    mesh = elasticity.mesh
    dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": FINE_QUADRATURE})
    cellwise = fem.functionspace(mesh, ("DG", 0, (4,)))
    off = elasticity.u - exact
    densities = [ufl.inner(elasticity.stress(v), ufl.sym(ufl.grad(v))) for v in (off, exact)]
    densities += [ufl.inner(v, v) for v in (off, exact)]
    form = fem.form(ufl.inner(ufl.as_vector(densities), ufl.TestFunction(cellwise)) * dx)
    sums = fem.assemble_vector(form).array.reshape(-1, 4).sum(axis=0)
    total = elasticity.prolongation.comm.allreduce(sums, op=MPI.SUM)
    energy, energy_scale, l2, l2_scale = np.sqrt(total)
    return FieldError(float(energy / energy_scale), float(l2 / l2_scale))


def energy_distance(elasticity, forest, values):
    """Distance of `elasticity.u` from another displacement of the same mesh.

    Collective.  The difference is integrated; a difference of energies would understate it, for node pairs on curved
    facets let the bodies overlap between them.

    Args:
        elasticity: Elasticity, its `u` set.
        forest: Forest of its mesh.
        values: (n, 8, 3) float64, the other displacement at the corners of this rank's leaves [m].

    Returns:
        float, norm of the difference over the norm of `elasticity.u` [-].
    """
    leaf, corner = forest.vertices.example.T
    off = fem.Function(elasticity.space)
    off.x.array[:] = elasticity.u.x.array - values[leaf, corner][elasticity.vertex_of_block].ravel()
    dx = ufl.Measure("dx", elasticity.mesh, metadata={"quadrature_degree": QUADRATURE_DEGREE})
    cellwise = fem.functionspace(elasticity.mesh, ("DG", 0, (2,)))
    densities = [ufl.inner(elasticity.stress(v), ufl.sym(ufl.grad(v))) for v in (off, elasticity.u)]
    form = fem.form(ufl.inner(ufl.as_vector(densities), ufl.TestFunction(cellwise)) * dx)
    sums = fem.assemble_vector(form).array.reshape(-1, 2).sum(axis=0)
    total = elasticity.prolongation.comm.allreduce(sums, op=MPI.SUM)
    return float(np.sqrt(total[0] / total[1]))
