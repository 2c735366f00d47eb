"""Stress recovery of O. C. Zienkiewicz, J. Z. Zhu (1987): a stress sigma* from the sigma_h of the cells, continuous in
each material of a body."""

import numpy as np
import ufl
from dolfinx import fem

from fx_contact.estimate.shear_free import ShearFree
from fx_contact.fem.displacement_field import DisplacementField, Integral
from fx_contact.fem.elasticity import Elasticity
from fx_contact.items.materials import VOIGT
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.timing import Stages

#: Degree of the Gauss rule with 2 x 2 x 2 points, at which stresses of degree 2 are superconvergent.
_SUPERCONVERGENT = 3


def von_mises(stress: FloatArray) -> FloatArray:
    """Von Mises stress of stresses (..., 6) in the order of `VOIGT`: (...) [Pa].  Local."""
    x, y, z, yz, xz, xy = np.moveaxis(stress, -1, 0)
    return np.asarray(np.sqrt(((x - y) ** 2 + (y - z) ** 2 + (z - x) ** 2) / 2 + 3 * (yz**2 + xz**2 + xy**2)))


def six(tensor: ufl.core.expr.Expr) -> list[ufl.core.expr.Expr]:
    """The components of a symmetric tensor in UFL, in the order of `VOIGT`.  Local."""
    return [tensor[i, j] for i, j in VOIGT]


class StressRecovery:
    """The recovered stress sigma* of displacements on a mesh.

    Collective.  sigma* is the lumped L2 projection of sigma_h on the conforming nodes with 2 x 2 x 2 Gauss points: at
    degree 2 the mean, weighted by volume, of stresses extrapolated from superconvergent points.  At a node
    on an interface of two materials each has a sigma* of its own, of its cells alone (`NodalStress`).

    Raises CompilationError as `compiled`.
    """

    def __init__(self, elasticity: Elasticity, shear_free: ShearFree, stages: Stages) -> None:
        self._elasticity, self._shear_free = elasticity, shear_free
        self._space = elasticity.stresses.space(6)
        test, u = ufl.TestFunction(elasticity.stresses.space(7)), elasticity.argument
        gauss = ufl.Measure("dx", elasticity.mesh, metadata={"quadrature_degree": _SUPERCONVERGENT})
        integrand = ufl.inner(ufl.as_vector([*six(elasticity.stress(u)), 1]), test)
        with stages("compile"):
            self._moments = Integral(elasticity.prolongation.comm, integrand * gauss, [u])

    def stress(self, field: DisplacementField) -> fem.Function:
        """sigma* of a displacement, six components a node (`VOIGT`) [Pa].  Collective."""
        stresses, result = self._elasticity.stresses, fem.Function(self._space, name="stress")
        sums = stresses.restrict(self._moments.vector(field))
        self._shear_free.remove_shear(sums)
        volume = sums[..., 6:]
        result.x.array[:] = stresses.array(np.divide(sums[..., :6], volume, out=0 * sums[..., :6], where=volume != 0))
        return result
