"""The part of Hooke's law beyond an isotropic one, on cells of orthotropic materials."""

from collections.abc import Sequence

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh

from fx_contact.items.materials import TENSOR, VOIGT, Material, Orthotropic
from fx_contact.parallel.arrays import FloatArray, IntArray


class Anisotropy:
    """C - C_iso and C^-1 of each cell, with C_iso of the nearest isotropic material.

    Collective on the mesh's communicator.

    Args:
        materials: those of the mesh.
        material: (ncells,), index of that of each local cell.
    """

    def __init__(self, mesh: Mesh, materials: Sequence[Material | Orthotropic], material: IntArray) -> None:
        space = fem.functionspace(mesh, ("DG", 0, (6, 6)))
        self._more, self._compliance = fem.Function(space), fem.Function(space)
        more = np.array([one.stiffness - one.isotropic.stiffness for one in materials])
        compliance = np.array([np.linalg.inv(one.stiffness) for one in materials])
        for function, values in ((self._more, more), (self._compliance, compliance)):
            cells: FloatArray = function.x.array.reshape(-1, 6, 6)
            cells[space.dofmap.list[:, 0]] = values[material]

    def stress(self, strain: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """(C - C_iso) eps [Pa].  Local."""
        angles = ufl.as_vector([(1 if i == j else 2) * strain[i, j] for i, j in VOIGT])
        six = ufl.dot(self._more, angles)
        return ufl.as_matrix([[six[component] for component in row] for row in TENSOR])

    def work(self, one: ufl.core.expr.Expr, other: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """One stress : C^-1 the other [Pa].  Local."""
        first, second = (ufl.as_vector([stress[i, j] for i, j in VOIGT]) for stress in (one, other))
        return ufl.inner(first, ufl.dot(self._compliance, second))
