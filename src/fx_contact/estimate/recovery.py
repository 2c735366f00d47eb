"""Stress recovery and the error estimate of O. C. Zienkiewicz, J. Z. Zhu (1987): indicator (3), energies (4).

At degree 2 the larger of (3) and of the element residual counts in each cell.  (3) shows what jumps from cell to cell,
as beside contact edges, but little of a smooth error, which the element residual shows.  Effectivities:
`studies/effectivity`.
"""

from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

from fx_contact.estimate.element_residual import ElementResidual
from fx_contact.estimate.shear_free import VOIGT
from fx_contact.fem.compilation import compiled
from fx_contact.fem.space import child_error
from fx_contact.parallel.errors import SolveError

#: Position in `VOIGT` of each component of a symmetric tensor.
TENSOR = ((0, 5, 4), (5, 1, 3), (4, 3, 2))
#: Degree of the Gauss rule with 2 x 2 x 2 points, at which stresses of degree 2 are superconvergent.
_SUPERCONVERGENT = 3


def von_mises(stress):
    """Von Mises stress of stresses (..., 6) in the order of `VOIGT`: (...) [Pa].  Local."""
    x, y, z, yz, xz, xy = np.moveaxis(stress, -1, 0)
    return np.sqrt(((x - y) ** 2 + (y - z) ** 2 + (z - x) ** 2) / 2 + 3 * (yz**2 + xz**2 + xy**2))


@dataclass(frozen=True, eq=False)
class Estimate:
    """Estimated error and energy of a displacement field.

    Attributes:
        stress: recovered stress sigma*, a dolfinx Function of six components a node (`VOIGT`) [Pa].
        error: (ncells,) float64, xi_T of this rank's cells (3) [J^(1/2)].
        energy: (ncells,) float64, strain energy of this rank's cells, twice [J].
        error_global: xi of all cells (6) [J^(1/2)].
        energy_norm: omega (4) [J^(1/2)].
        cells: number of cells on all ranks.
        child_error: xi_T^2 of a child over that of its parent if the solution is smooth, `fem.space.child_error` [-].
    """

    stress: object
    error: np.ndarray
    energy: np.ndarray
    error_global: float
    energy_norm: float
    cells: int
    child_error: float

    @property
    def relative(self):
        """xi / omega [-]."""
        return self.error_global / self.energy_norm if self.energy_norm else 0.0


class Recovery:
    """The recovered stress sigma* on a mesh, and the error that it shows of sigma_h.

    Collective.  sigma* is the lumped L2 projection of sigma_h on the conforming nodes, integrated with 2 x 2 x 2 Gauss
    points.  At degree 2 that is the mean, weighted by volume, of stresses extrapolated from these superconvergent
    points to each node.  Bodies share no node, so that each is recovered by itself.

    Args:
        elasticity: Elasticity.
        shear_free: ShearFree, where there is no shear stress by symmetry.
        stages: Stages, for the times.
        body_force: UFL vector on the mesh [N/m^3]; None: there is none.
    """

    def __init__(self, elasticity, shear_free, stages, body_force=None):
        self._prolongation, self._elasticity = elasticity.prolongation, elasticity
        self._shear_free, mesh, comm = shear_free, elasticity.mesh, self._prolongation.comm
        dx, gauss = (
            ufl.Measure("dx", mesh, metadata={"quadrature_degree": degree})
            for degree in (elasticity.quadrature_degree, _SUPERCONVERGENT)
        )
        moments = elasticity.nodal_space(7)
        self._recovered = fem.Function(elasticity.nodal_space(6), name="stress")
        cellwise = fem.functionspace(mesh, ("DG", 0, (2,)))
        with stages("compile"):
            sigma = elasticity.stress(elasticity.u, elasticity.volume_strain)
            integrand = ufl.as_vector([*(sigma[i, j] for i, j in VOIGT), 1])
            self._moments = compiled(comm, ufl.inner(integrand, ufl.TestFunction(moments)) * gauss)
            smooth = ufl.as_matrix([[self._recovered[component] for component in row] for row in TENSOR])
            both = ufl.as_vector([_energy(elasticity, smooth - sigma), _energy(elasticity, sigma)])
            self._energies = compiled(comm, ufl.inner(both, ufl.TestFunction(cellwise)) * dx)
        self._residual = None
        if self._prolongation.space.degree % 2 == 0:
            self._residual = ElementResidual(elasticity, sigma, body_force, stages)

    def estimate(self, noise=0.0, loaded=True):
        """Recover the stress of the elasticity's displacement `u`, and estimate its error.

        Collective.

        Args:
            noise: energy norm up to which `u` is taken for a rigid motion, without error [J^(1/2)].
            loaded: whether the body force acts; not on a dual solution.

        Returns:
            Estimate.

        Raises:
            SolveError: the energy is not a finite number.
        """
        prolongation = self._prolongation
        sums = prolongation.restrict(self._elasticity.at_nodes(fem.assemble_vector(self._moments).array))
        self._shear_free.remove_shear(sums)
        values = prolongation.prolong(sums[:, :6] / sums[:, 6:])
        self._recovered.x.array[:] = self._elasticity.at_blocks(values)

        energies = fem.assemble_vector(self._energies).array.reshape(-1, 2)
        error2, energy2 = np.maximum(energies, 0).T
        if self._residual is not None:
            error2 = np.maximum(error2, self._residual.error2(loaded))
        total = prolongation.comm.allreduce(np.array([error2.sum(), energy2.sum(), len(error2)]), op=MPI.SUM)
        if not np.isfinite(total).all():
            raise SolveError("the strain energy is not a finite number: check the units of moduli and lengths")
        error, omega = float(np.sqrt(total[0])), float(np.sqrt(total[0] + total[1]))
        if omega <= noise:
            error2, energy2, error, omega = np.zeros_like(error2), np.zeros_like(energy2), 0.0, 0.0
        return Estimate(
            stress=self._recovered.copy(),
            error=np.sqrt(error2),
            energy=energy2,
            error_global=error,
            energy_norm=omega,
            cells=int(total[2]),
            child_error=child_error(prolongation.space.degree),
        )


def _energy(elasticity, stress):
    """stress : C^-1 stress, twice the energy density."""
    first, second = elasticity.lame
    trace = ufl.tr(stress)
    return (ufl.inner(stress, stress) - first / (3 * first + 2 * second) * trace**2) / (2 * second)
