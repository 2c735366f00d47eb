"""The element residual: the error that equilibrium shows, by small problems in each cell.

At even degree the stress errors of a smooth solution are continuous from cell to cell, like (xi^3 - xi)' at degree 2:
means over cells hardly change them.  The functions xi^3 - xi along each axis, which the space lacks, show them (R. E.
Bank, A. Weiser, Math. Comp. 44, 1985; on the choice of functions M. Ainsworth, Numer. Math. 73, 1996).
"""

import basix.ufl
import numpy as np
import ufl
from basix import CellType, LagrangeVariant
from dolfinx import fem

from fx_contact.fem.compilation import compiled
from fx_contact.fem.leaf_mesh import basix_order
from fx_contact.problem import hexahedron


class ElementResidual:
    """The error of each cell T in functions of its own.

    Collective.  With b the integral of the Legendre polynomial of degree p, zero at both ends of an edge

        e_T in span{b(xi), b(eta), b(zeta)}^3,    xi_T^2 = a_T(e_T, e_T),
        a_T(e_T, v) = int_T (f + div sigma_h) . v.

    There are no tractions on facets: what jumps there is that of (3).  On cells h wide and H high an error of theirs
    would count (H / h)^2 times, for b(zeta) along H moves the cross-sections almost freely: beside hanging nodes
    xi_T was up to four times the error at 1:40 (`between-nodes/all-held-4-x-4-height/5` of studies/stability).

    Args:
        elasticity: Elasticity.
        stress: sigma_h, a UFL expression (3, 3) [Pa].
        body_force: f, a UFL vector [N/m^3]; None: there is none.
        stages: Stages, for the times.
    """

    def __init__(self, elasticity, stress, body_force, stages):
        mesh, comm = elasticity.mesh, elasticity.prolongation.comm
        dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": elasticity.quadrature_degree})
        bubbles = _bubbles(mesh, elasticity.prolongation.space.degree)
        weights = fem.functionspace(mesh, ("DG", 0, (3, 3)))
        e, v = (ufl.dot(bubbles, c) for c in (ufl.TrialFunction(weights), ufl.TestFunction(weights)))
        self._loaded, force = fem.Constant(mesh, 1.0), ufl.div(stress)
        if body_force is not None:
            force += self._loaded * body_force
        residual, energy = ufl.inner(force, v), ufl.inner(elasticity.stress(e), ufl.sym(ufl.grad(v)))
        with stages("compile"):
            self._residual, stiffness = compiled(comm, residual * dx), compiled(comm, energy * dx)
        self._stiffness = fem.assemble_matrix(stiffness).data.reshape(-1, 9, 9)

    def error2(self, loaded=True):
        """xi_T^2 of this rank's cells: (ncells,) float64 [J].

        Local.

        Args:
            loaded: whether the body force acts.
        """
        self._loaded.value = float(loaded)
        residual = fem.assemble_vector(self._residual).array.reshape(-1, 9)
        error = np.linalg.solve(self._stiffness, residual[:, :, None])[:, :, 0]
        return (residual * error).sum(axis=1)


def _bubbles(mesh, degree):
    """b along each axis of each cell: a Function of three components, discontinuous."""
    order = degree + 1
    element = basix.ufl.element(
        "Lagrange", "hexahedron", order, lagrange_variant=LagrangeVariant.equispaced, discontinuous=True, shape=(3,)
    )
    bubbles = fem.Function(fem.functionspace(mesh, element))
    points = hexahedron.grid_points(order)[basix_order(CellType.hexahedron, order)] / order
    integral = np.polynomial.Legendre.basis(degree, [0, 1]).integ(lbnd=0)
    bubbles.x.array.reshape(-1, 3)[bubbles.function_space.dofmap.list] = integral(points)
    return bubbles
