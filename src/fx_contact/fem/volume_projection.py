"""The volume strain of nearly incompressible bodies, projected in each cell.

The volume strain is projected in each cell on the polynomials q of degree p - 1 in reference coordinates, which
prevents locking.  Its energy is

    lambda m^T M^-1 m,    m_i = int q_i div u,    M_ij = int q_i q_j.

That is the pair Q_p / P_(p-1) discontinuous with the pressure eliminated (D. S. Malkus, T. J. R. Hughes, Comput.
Methods Appl. Mech. Eng. 15(1), 1978).  At degree 1 that is the mean of each cell (B-bar: J. C. Nagtegaal, D. M. Parks,
J. R. Rice, Comput. Methods Appl. Mech. Eng. 4(2), 1974).  Linear displacements stay exact on distorted cells.
"""

import numpy as np
from dolfinx import fem
from dolfinx.mesh import Mesh

from fx_contact.fem.cell_stiffness import CellStiffness
from fx_contact.parallel.arrays import FloatArray


class VolumeProjection:
    """Projection of functions by the Gauss rule of a stiffness on polynomials of degree p - 1 in each cell.

    Collective on the mesh's communicator at its making.

    Attributes:
        space: discontinuous polynomials of degree p - 1.
    """

    def __init__(self, mesh: Mesh, cells: CellStiffness) -> None:
        self.space = fem.functionspace(mesh, ("DPC", cells.degree - 1))
        every = np.arange(len(self.space.dofmap.list))
        values = self.space.element.basix_element.tabulate(0, cells.grid)[0, :, :, 0]
        self._inverse_mass = np.linalg.inv(values.T @ (cells.volumes(every)[:, :, None] * values))

    def projected(self, moments: FloatArray) -> FloatArray:
        """The array of a Function of `space` that has the moments (n,) m.  Local."""
        cells, result = self.space.dofmap.list, np.empty_like(moments)
        result[cells] = np.einsum("nij,nj->ni", self._inverse_mass, moments[cells])
        return result
