"""Stress that is shown: errors in the energy norm against known stresses.

    python3 -m studies.effectivity.stress    # two minutes

The stress of the cells (raw), that of the error estimate (recovered) and the L2 projection, which `Step.stress` is: on
a manufactured solution, and on HERTZ-A, whose stress is known from `studies.incompressible.axisymmetric`.  It leaves
stress.csv in results/effectivity.
"""

import argparse
from collections.abc import Callable
from pathlib import Path

import basix
import numpy as np
import numpy.typing as npt
import ufl
from basix.ufl import element
from dolfinx import fem, geometry
from dolfinx.fem.petsc import LinearProblem

from demos.manufactured_solution import adapt_manufactured, bump
from fx_contact import adapt
from fx_contact.estimate.shear_free import ShearFree, find_shear_free
from fx_contact.estimate.stress_projection import projected_stress
from fx_contact.estimate.stress_recovery import StressRecovery, six
from fx_contact.fem.displacement_field import DisplacementField
from fx_contact.fem.elasticity import Elasticity
from fx_contact.parallel.timing import Stages
from fx_contact.scenes import hertz
from studies.incompressible import axisymmetric
from studies.tables import plain, write

Array = npt.NDArray[np.float64]
#: Degree of the Gauss rule.
QUADRATURE = 6
POISSON = 0.3


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


class Axisymmetric:
    """The stress of half-spheres in contact, above and below the plane z = 0."""

    def __init__(self) -> None:
        self._mesh = mesh = axisymmetric.half_disc(60)
        u, p = ufl.split(axisymmetric.solved(POISSON, mesh)[0])
        shear, slope, r = axisymmetric.YOUNG / (2 * (1 + POISSON)), ufl.grad(u), ufl.SpatialCoordinate(mesh)[0]
        normal = [2 * shear * strain - p for strain in (slope[0, 0], slope[1, 1], u[0] / r)]
        space = fem.functionspace(mesh, element("DG", "triangle", 1, shape=(4,)))
        trial, test = ufl.TrialFunction(space), ufl.TestFunction(space)
        stress = ufl.as_vector([*normal, shear * (slope[0, 1] + slope[1, 0])])
        dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": 4})
        forms = ufl.inner(trial, test) * dx, ufl.inner(stress, test) * dx
        options = {"ksp_type": "preonly", "pc_type": "lu"}
        self._stress = LinearProblem(*forms, petsc_options=options).solve()
        self._tree = geometry.bb_tree(mesh, 2, padding=1e-4)

    def __call__(self, elasticity: Elasticity) -> Array:
        """At the Gauss points of all cells: (ncells, points, 6)."""
        position = at_points(elasticity, ufl.SpatialCoordinate(elasticity.mesh), 3)
        x, y, z = position.reshape(-1, 3).T
        r, height = np.hypot(x, y), np.abs(z) - axisymmetric.RADIUS
        inwards = np.minimum(1.0, (1 - 1e-7) * axisymmetric.RADIUS / np.hypot(r, height))  # off the curved edge
        points = np.stack([inwards * r, axisymmetric.RADIUS + inwards * height, 0 * r], axis=1)
        near = geometry.compute_collisions_points(self._tree, points)
        inside = geometry.compute_colliding_cells(self._mesh, near, points)
        cells = np.where(
            np.diff(inside.offsets) > 0,
            inside.array[inside.offsets[:-1] % len(inside.array)],
            near.array[near.offsets[:-1]],
        )
        radial, axial, hoop, shear = self._stress.eval(points, cells.astype(np.int32)).T
        c, s, side = x / r, y / r, np.sign(z)
        six = [radial * c**2 + hoop * s**2, radial * s**2 + hoop * c**2, axial]
        six += [side * shear * s, side * shear * c, (radial - hoop) * c * s]
        return np.stack(six, axis=1).reshape(*position.shape[:2], 6)


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


def of_hertz(degree: int, tolerance: float, exact: Axisymmetric) -> list[dict[str, object]]:
    """Rows of HERTZ-A; of a first mesh without the contact's shape there is none."""
    rows = []
    for step in adapt(hertz(order=6, coarse=2), tolerance, degree=degree):
        if step.record.step:
            shear_free = find_shear_free(step.scene, step.forest, step.elasticity.prolongation)
            found = errors(step.elasticity, step.field, shear_free, exact)
            rows.append({"problem": "HERTZ-A", "degree": degree, "dofs": step.record.dofs} | found)
    return rows


def main() -> None:
    """All problems; print the table and keep it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--tolerance", type=float, default=0.01, help="at degree 2; ten times that at 1 (%(default)s)"
    )
    parser.add_argument("--output", type=Path, default=Path("results/effectivity"))
    arguments, exact, rows = parser.parse_args(), Axisymmetric(), []
    for degree, tolerance in ((2, arguments.tolerance), (1, 10 * arguments.tolerance)):
        rows += of_manufactured(degree, tolerance) + of_hertz(degree, tolerance, exact)
    write(arguments.output / "stress.csv", rows)
    print(plain(rows))


if __name__ == "__main__":
    main()
