"""Stress that is shown: errors in the energy norm against known stresses.

    python3 -m studies.effectivity.stress    # two minutes

The stress of the cells (raw), that of the error estimate (recovered) and the L2 projection, which `Step.stress` is: on
a manufactured solution, and on HERTZ-A, whose stress is known from `studies.effectivity.hertz_truth`.  It leaves
stress.csv in results/effectivity.
"""

from collections.abc import Callable

import basix
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem

from demos.manufactured_solution import adapt_manufactured, bump
from fx_contact import adapt
from fx_contact.estimate.shear_free import ShearFree, find_shear_free
from fx_contact.estimate.stress_projection import projected_stress
from fx_contact.estimate.stress_recovery import StressRecovery, six
from fx_contact.fem.displacement_field import DisplacementField
from fx_contact.fem.elasticity import Elasticity
from fx_contact.parallel.timing import Stages
from fx_contact.scenes import hertz
from studies.effectivity.hertz_truth import FIRST, SHEAR, Truth
from studies.tables import options, tabulate

Array = npt.NDArray[np.float64]
#: Degree of the Gauss rule.
QUADRATURE = 6


def errors(
    elasticity: Elasticity, field: DisplacementField, shear_free: ShearFree, exact: Callable[[Elasticity], Array]
) -> dict[str, float]:
    """Errors of the stresses of a displacement, relative to the exact one (ncells, points, 6)."""
    stages, known = Stages(), exact(elasticity)
    stresses = {
        "raw": ufl.as_vector(six(elasticity.stress(field))),
        "recovered": StressRecovery(elasticity, shear_free, stages).stress(field),
        "projected": projected_stress(elasticity, field, shear_free, stages),
    }
    size = energy(elasticity, known)
    return {
        name: np.sqrt(energy(elasticity, at_points(elasticity, stress, 6) - known) / size)
        for name, stress in stresses.items()
    }


def at_points(elasticity: Elasticity, expression: ufl.core.expr.Expr, components: int) -> Array:
    """Values at the Gauss points of all cells: (ncells, points, components)."""
    points, _ = basix.make_quadrature(basix.CellType.hexahedron, QUADRATURE)
    cells = np.arange(len(elasticity.cells), dtype=np.int32)
    values = fem.Expression(expression, points).eval(elasticity.mesh, cells)
    return np.asarray(values).reshape(len(cells), len(points), components)


def energy(elasticity: Elasticity, stress: Array) -> float:
    """int s : C^-1 s over all cells."""
    _, weights = basix.make_quadrature(basix.CellType.hexahedron, QUADRATURE)
    volume = np.abs(at_points(elasticity, ufl.JacobianDeterminant(elasticity.mesh), 1))[:, :, 0] * weights
    first, second = (lame.x.array[lame.function_space.dofmap.list] for lame in elasticity.lame)
    square = (stress[..., :3] ** 2).sum(axis=2) + 2 * (stress[..., 3:] ** 2).sum(axis=2)
    trace = stress[..., :3].sum(axis=2)
    return float((volume * (square - first / (3 * first + 2 * second) * trace**2) / (2 * second)).sum())


def of_manufactured(degree: int, tolerance: float) -> list[dict[str, object]]:
    """Rows of a manufactured solution."""

    def exact(elasticity: Elasticity) -> Array:
        """The known stress."""
        stress = elasticity.hooke(ufl.as_vector(bump(ufl.SpatialCoordinate(elasticity.mesh))))
        return at_points(elasticity, ufl.as_vector(six(stress)), 6)

    rows = []
    for step in adapt_manufactured(tolerance, degree=degree):
        nowhere = ShearFree(np.zeros((step.elasticity.prolongation.owned, 3), dtype=bool))
        found = errors(step.elasticity, step.field, nowhere, exact)
        rows.append({"problem": "manufactured", "degree": degree, "dofs": step.record.dofs} | found)
    return rows


def of_hertz(degree: int, tolerance: float, truth: Truth) -> list[dict[str, object]]:
    """Rows of HERTZ-A; of a first mesh without the contact's shape there is none."""

    def exact(elasticity: Elasticity) -> Array:
        """The stress of the axisymmetric solution."""
        position = at_points(elasticity, ufl.SpatialCoordinate(elasticity.mesh), 3)
        strain = truth.at(position.reshape(-1, 3)).reshape(*position.shape[:2], 3, 3)
        trace = np.trace(strain, axis1=2, axis2=3)[..., None, None]
        stress = 2 * SHEAR * strain + FIRST * trace * np.eye(3)
        return np.stack([stress[..., i, j] for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))], axis=2)

    rows = []
    for step in adapt(hertz(order=6, coarse=2), tolerance, degree=degree):
        if step.record.step:
            shear_free = find_shear_free(step.scene, step.forest, step.elasticity.prolongation)
            found = errors(step.elasticity, step.field, shear_free, exact)
            rows.append({"problem": "HERTZ-A", "degree": degree, "dofs": step.record.dofs} | found)
    return rows


def main() -> None:
    """All problems; print the table and keep it."""
    parser = options(__doc__, "effectivity")
    parser.add_argument(
        "--tolerance", type=float, default=0.01, help="at degree 2; ten times that at 1 (%(default)s)"
    )
    given, truth, rows = parser.parse_args(), Truth(60), []
    for degree, tolerance in ((2, given.tolerance), (1, 10 * given.tolerance)):
        rows += of_manufactured(degree, tolerance) + of_hertz(degree, tolerance, truth)
    tabulate(rows, given.output / "stress.csv")


if __name__ == "__main__":
    main()
