"""Manufactured solution: a problem with a known discretisation error, to test the estimate.

A smooth displacement u is prescribed on a quarter of a ring.  The loads are the body force f = -div sigma(u) and the
tractions t = sigma(u) n; both ends of the ring have prescribed displacements.  There is no contact.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from mpi4py import MPI

from fx_contact.adaptive.settings import DEGREE
from fx_contact.adaptive.solve_record import SolveRecord, record_of_solve
from fx_contact.contact.contact_problem import ContactProblem, SolveOptions
from fx_contact.estimate.error_control import ErrorControl
from fx_contact.estimate.estimator import Estimate, Estimator
from fx_contact.estimate.shear_free import ShearFree
from fx_contact.fem.coarse_level import create_coarse_level
from fx_contact.fem.displacement_field import DisplacementField
from fx_contact.fem.elasticity import Elasticity
from fx_contact.fem.leaf_mesh import create_leaf_mesh
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.fem.sum_factorisation import matrix_free
from fx_contact.fem.supports import Supports
from fx_contact.forest.forest import Forest
from fx_contact.forest.partition import repartition
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.geometry.shapes import root_mesh_from_shapes
from fx_contact.geometry.solids import ring
from fx_contact.items.materials import Material
from fx_contact.law.contact_solver import solve_contact
from fx_contact.linalg.solver_options import Solver
from fx_contact.parallel.compilation import compiled
from fx_contact.parallel.timing import Stages
from fx_contact.results.accuracy import field_error, fine_quadrature
from fx_contact.surfaces.contact_surfaces import ContactSurfaces
from fx_contact.surfaces.facet_pairing import Pairing

#: Centre x_c on the inner surface, width w and direction d of u = d exp(-|x - x_c|^2 / (2 w^2)) [m].
_CENTRE, _WIDTH, _DIRECTION = (0.5 / np.sqrt(2), 0.5 / np.sqrt(2), 0.25), 0.12, (0.6, -0.3, 1.0)
_MATERIAL = Material(young=1.0, poisson=0.3)


def quarter_ring(order: int = 3, coarse: int = 4) -> RootMesh:
    """Root mesh of a quarter of a ring: radii 0.5 and 1, height 0.5 [m].  Local.

    Its two straight ends are `start` and `end`, all other faces `outside`.

    Args:
        order: of the root mesh, 1 to 6.
        coarse: root cells across the ring; twice as many around it.
    """
    shape = ring(0.5, 1.0, 0.5, (coarse, 2 * coarse, coarse), order, quarters=1)
    outside = [f"ring {side}" for side in ("inside", "outside", "bottom", "top")]
    return root_mesh_from_shapes({"ring": shape}, {"start": "ring y = 0", "end": "ring x = 0", "outside": outside})


def bump(x: Any) -> list[Any]:
    """The displacement u = d exp(-|x - x_c|^2 / (2 w^2)) [m]; x has three UFL expressions or arrays [m].  Local."""
    exp = ufl.exp if isinstance(x[0], ufl.core.expr.Expr) else np.exp
    height = exp(-sum((a - b) ** 2 for a, b in zip(x, _CENTRE)) / (2 * _WIDTH**2))
    return [direction * height for direction in _DIRECTION]


@dataclass(frozen=True, kw_only=True)
class ManufacturedRecord(SolveRecord):
    """The figures of one step, with its true errors.

    Attributes:
        true_error: error relative to the solution in the energy norm [-].
        l2_error: the same in the L2 norm [-].
        effectivity: estimate over true error [-].
    """

    true_error: float
    l2_error: float
    effectivity: float


@dataclass(frozen=True, eq=False)
class ManufacturedStep:
    """The state after one step.

    Attributes:
        field: the displacement.
    """

    record: ManufacturedRecord
    forest: Forest
    elasticity: Elasticity
    field: DisplacementField
    estimate: Estimate


def adapt_manufactured(
    tolerance: float,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    *,
    degree: int = DEGREE,
    order: int = 3,
    coarse: int = 4,
    uniform: bool = False,
    control: ErrorControl | None = None,
    max_steps: int = 20,
) -> Iterator[ManufacturedStep]:
    """Solve the manufactured problem on finer and finer forests.

    Collective on comm; so is every step of the iteration.

    Args:
        tolerance: estimated error relative to the solution at which to stop [-].
        degree: p of the displacement, 1 or 2.
        order: of the root mesh and the leaf maps, 1 to 6.
        coarse: root cells across the ring.
        uniform: refine all leaves in each step, from a mesh whose lower half is finer, so that all steps have hanging
            nodes; else refine those that the control marks.
        control: for its marking alone; None: the default one.
        max_steps: most solves.
    """
    control = ErrorControl() if control is None else control
    mesh, step = quarter_ring(order, coarse), None
    for number in range(max_steps):
        stages = Stages()
        if step is None:
            forest = Forest.of_roots(comm, mesh, Pairing(mesh, ()), ContactSurfaces(mesh, ()))
            if uniform:
                forest, _ = forest.refined(forest.cell < len(mesh.cells) // 2)
        else:
            times = np.ones(len(forest), dtype=np.int8)
            if not uniform:
                times[step.elasticity.leaf_mesh.leaf] = control.marked(step.estimate, tolerance, 1.0, comm)
            forest, _ = forest.refined_with(times)
        with stages("partition"):
            forest, _ = repartition(forest, None, "contact-sfc")
        step = _solve(number, Space(forest, degree), order, tolerance, stages)
        yield step
        if step.record.estimate <= tolerance:
            return


def _solve(number: int, space: Space, order: int, tolerance: float, stages: Stages) -> ManufacturedStep:
    """Discretise, solve and estimate.  Collective."""
    forest = space.forest
    with stages("hanging"):
        prolongation = Prolongation(space)
    with stages("mesh"):
        cells = create_leaf_mesh(forest, order)
    with stages("assemble"):
        elasticity = Elasticity(cells, [_MATERIAL], np.zeros(len(forest), dtype=np.int32), prolongation, stages)
    with stages("system"):
        forces = _load(forest, elasticity, stages)
        supports = Supports(_prescribed(forest, prolongation))
    with stages("assemble"):
        matrix = (matrix_free if space.degree > 1 else Elasticity.stiffness)(elasticity, supports=supports)
        coarse = create_coarse_level(elasticity, supports) if space.degree > 1 else None
    start, exact = np.zeros((prolongation.owned, 3)), ufl.as_vector(bump(ufl.SpatialCoordinate(elasticity.mesh)))
    linear = ContactProblem(matrix, forces, supports, elasticity.energy_norm, coarse=coarse)
    solution = solve_contact(linear, start, SolveOptions(Solver()), stages)
    with stages("estimate"):
        field, nowhere = elasticity.field(solution.displacement), np.zeros((prolongation.owned, 3), dtype=bool)
        estimator = Estimator(elasticity, ShearFree(nowhere), stages, -ufl.div(elasticity.hooke(exact)))
        guess = estimator.error(field).estimate
    true = field_error(elasticity, field.function, exact)
    known = record_of_solve("manufactured", number, elasticity, solution, guess, tolerance, stages)
    record = ManufacturedRecord(
        **vars(known), true_error=true.energy, l2_error=true.l2, effectivity=guess.relative / true.energy
    )
    return ManufacturedStep(record, forest, elasticity, field, guess)


def _load(forest: Forest, elasticity: Elasticity, stages: Stages) -> npt.NDArray[np.float64]:
    """Nodal forces of f and t on the conforming nodes: (owned, 3) [N].  Collective."""
    mesh, test = elasticity.mesh, ufl.TestFunction(elasticity.function_space)
    mesh.topology.create_connectivity(2, 3)
    outside = elasticity.leaf_mesh.facets(forest, forest.mesh.surface("outside")).ravel()
    degree = {"quadrature_degree": fine_quadrature(elasticity)}
    ds = ufl.Measure("ds", mesh, subdomain_data=[(1, outside)], metadata=degree)
    dx = ufl.Measure("dx", mesh, metadata=degree)
    stress = elasticity.hooke(ufl.as_vector(bump(ufl.SpatialCoordinate(mesh))))
    work = -ufl.inner(ufl.div(stress), test) * dx + ufl.inner(stress * ufl.FacetNormal(mesh), test) * ds(1)
    with stages("compile"):
        form = compiled(forest.comm, work)
    return elasticity.prolongation.restrict(elasticity.at_nodes(fem.assemble_vector(form).array))


def _prescribed(forest: Forest, prolongation: Prolongation) -> npt.NDArray[np.float64]:
    """u at the conforming nodes of both ends of the ring: (owned, 3) [m], NaN elsewhere.  Collective."""
    space, on = prolongation.space, np.zeros(len(prolongation.space), dtype=bool)
    for name in ("start", "end"):
        on[space.on_faces(*forest.boundary_faces(forest.mesh.surface(name)))] = True
    on = np.flatnonzero(on & ~prolongation.hanging)
    return prolongation.averaged(prolongation.conforming[on], np.stack(bump(space.positions(on).T), axis=1))
