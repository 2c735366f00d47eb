"""The volume strain of nearly incompressible bodies, projected in each cell.

The volume strain is projected in each cell on the polynomials q of degree p - 1 in reference coordinates, which
prevents locking.  Its energy is

    lambda m^T M^-1 m,    m_i = int q_i div u,    M_ij = int q_i q_j.

That is the pair Q_p / P_(p-1) discontinuous with the pressure eliminated (D. S. Malkus, T. J. R. Hughes, Comput.
Methods Appl. Mech. Eng. 15(1), 1978).  At degree 1 that is the mean of each cell (B-bar: J. C. Nagtegaal, D. M. Parks,
J. R. Rice, Comput. Methods Appl. Mech. Eng. 4(2), 1974).  Linear displacements stay exact on distorted cells.
"""

from collections.abc import Callable

import numpy as np
import ufl
from dolfinx import fem

from fx_contact.fem.cell_products import cell_matrices
from fx_contact.parallel.arrays import FloatArray, IntArray

#: Compiles an integrand over some of this rank's cells; None: all.
Compile = Callable[[ufl.core.expr.Expr, IntArray | None], fem.Form]


class VolumeProjection:
    """Projection of the divergence of displacements of degree p.

    Collective on the mesh's communicator.  Raises CompilationError as `compiled`.

    Args:
        displacements: vectors of degree p, discontinuous.

    Attributes:
        space: discontinuous polynomials of degree p - 1.
        inverse_mass: (ncells, k, k), M^-1 of each cell [1/m^3].
    """

    def __init__(self, displacements: fem.FunctionSpace, degree: int, compiled: Compile) -> None:
        mesh = displacements.mesh
        self.space = fem.functionspace(mesh, ("DPC", degree - 1))
        # dolfinx assembles square blocks alone: the three terms of the divergence have a row each.
        self._terms = fem.functionspace(mesh, ("DPC", degree - 1, (3,)))
        self._displacements = displacements
        q, test = ufl.TrialFunction(self.space), ufl.TestFunction(self.space)
        order, mass = cell_matrices(compiled(q * test, None), self.space.dofmap.list, self.space.dofmap.list)
        self.inverse_mass = np.empty_like(mass)
        self.inverse_mass[order] = np.linalg.inv(mass)

    def projected(self, moments: FloatArray) -> FloatArray:
        """The array of a Function of `space` that has the moments (n,) m.  Local."""
        cells, result = self.space.dofmap.list, np.empty_like(moments)
        result[cells] = np.einsum("nij,nj->ni", self.inverse_mass, moments[cells])
        return result

    def moments(self, cells: IntArray, compiled: Compile) -> tuple[IntArray, FloatArray]:
        """Cells (n,) in their new order and their matrices D (n, q, 3 k) with m = D u [m^2].  Collective."""
        trial, test = ufl.TrialFunction(self._displacements), ufl.TestFunction(self._terms)
        form = compiled(sum(test[i] * trial[i].dx(i) for i in range(3)), cells)
        order, d = cell_matrices(form, self._terms.dofmap.list[cells], self._displacements.dofmap.list[cells])
        n, count, k, *_ = d.shape
        return cells[order], d.sum(axis=3).reshape(n, count, 3 * k)
