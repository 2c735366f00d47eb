"""The element residual: the error that equilibrium shows, by small problems in each cell.

At even degree stress errors of a smooth solution are continuous from cell to cell, like (xi^3 - xi)' at degree 2, and
means over cells hardly change them.  Functions such as xi^3 - xi along each axis show them (R. E. Bank, A. Weiser,
Math. Comp. 44, 1985; M. Ainsworth, Numer. Math. 73, 1996).
"""

import basix.ufl
import numpy as np
import ufl
from basix import CellType, LagrangeVariant
from dolfinx import fem
from dolfinx.mesh import Mesh

from fx_contact.fem.displacement_field import DisplacementField, Integral
from fx_contact.fem.elasticity import Elasticity
from fx_contact.fem.leaf_mesh import basix_order
from fx_contact.geometry import hexahedron
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.compilation import compiled
from fx_contact.parallel.timing import Stages


class ElementResidual:
    """The error of each cell T in functions of its own.

    Collective.  With b the integral of the Legendre polynomial of degree p, zero at both ends of an edge

        e_T in span{b(xi), b(eta), b(zeta)}^3,    xi_T^2 = a_T(e_T, e_T),
        a_T(e_T, v) = int_T (f + div sigma_h) . v.

    Jumps of tractions on facets are left to (3): on cells of aspect 1:40 beside hanging nodes they made xi_T up to four
    times the error (`between-nodes/all-held-4-x-4-height/5` of studies/stability).

    Args:
        body_force: f, a UFL vector [N/m^3]; None: 0.
    """

    def __init__(self, elasticity: Elasticity, body_force: ufl.core.expr.Expr | None, stages: Stages) -> None:
        mesh, comm, dx, u = elasticity.mesh, elasticity.prolongation.comm, elasticity.measure(), elasticity.argument
        bubbles = _bubbles(mesh, elasticity.prolongation.space.degree)
        weights = fem.functionspace(mesh, ("DG", 0, (3, 3)))
        e, v = (ufl.dot(bubbles, c) for c in (ufl.TrialFunction(weights), ufl.TestFunction(weights)))
        self._loaded, force = fem.Constant(mesh, np.float64(1.0)), ufl.div(elasticity.stress(u))
        if body_force is not None:
            force += self._loaded * body_force
        residual, energy = ufl.inner(force, v), ufl.inner(elasticity.hooke(e), ufl.sym(ufl.grad(v)))
        with stages("compile"):
            self._residual, stiffness = Integral(comm, residual * dx, [u]), compiled(comm, energy * dx)
        self._stiffness = fem.assemble_matrix(stiffness).data.reshape(-1, 9, 9)

    def of(self, field: DisplacementField, loaded: bool = True) -> tuple[FloatArray, FloatArray]:
        """The right-hand side r of each cell, with the body force if it is loaded, and the coefficients of e_T.

        Local.  r (ncells, 9) [J/m] and e_T (ncells, 9) [m]; r . e_T is xi_T^2 [J].
        """
        self._loaded.value = float(loaded)
        residual = self._residual.vector(field).reshape(-1, 9)
        return residual, np.linalg.solve(self._stiffness, residual[:, :, None])[:, :, 0]


def _bubbles(mesh: Mesh, degree: int) -> fem.Function:
    """b along each axis of each cell: three components, discontinuous."""
    order = degree + 1
    element = basix.ufl.element(
        "Lagrange", "hexahedron", order, lagrange_variant=LagrangeVariant.equispaced, discontinuous=True, shape=(3,)
    )
    bubbles = fem.Function(fem.functionspace(mesh, element))
    points = hexahedron.grid_points(order)[basix_order(CellType.hexahedron, order)] / order
    integral = np.polynomial.Legendre.basis(degree, [0, 1]).integ(lbnd=0)
    bubbles.x.array.reshape(-1, 3)[bubbles.function_space.dofmap.list] = integral(points)
    return bubbles
