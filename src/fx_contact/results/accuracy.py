"""Errors relative to known solutions, and to a solution on a refinement."""

from dataclasses import dataclass, replace

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from ufl.core.expr import Expr

from fx_contact.adaptive.beginning import Beginning
from fx_contact.adaptive.solving import solve
from fx_contact.adaptive.step import Step, check_step
from fx_contact.adaptive.step_record import TrueError
from fx_contact.estimate.error_control import ErrorControl
from fx_contact.estimate.marking import for_tolerance
from fx_contact.fem.elasticity import Elasticity
from fx_contact.forest.forest import Forest
from fx_contact.geometry.lattice import Lattice
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.compilation import compiled
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.validation import check_tolerance
from fx_contact.scene.scene import Scene, check_scene
from fx_contact.verdict.model_warning import REFUSED


@dataclass(frozen=True)
class FieldError:
    """Relative errors ||u_h - u|| / ||u|| of a displacement, in the energy norm and in the L2 norm [-]."""

    energy: float
    l2: float


@collective("elasticity.prolongation.comm")
def field_error(elasticity: Elasticity, u: fem.Function, exact: Expr) -> FieldError:
    """Relative errors of a displacement u against a known one [m], both on the elasticity's mesh.  Collective."""
    mesh = elasticity.mesh
    dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": fine_quadrature(elasticity)})
    cellwise = fem.functionspace(mesh, ("DG", 0, (4,)))
    off = u - exact
    densities = [ufl.inner(elasticity.hooke(v), ufl.sym(ufl.grad(v))) for v in (off, exact)]
    densities += [ufl.inner(v, v) for v in (off, exact)]
    comm, integrand = elasticity.prolongation.comm, ufl.inner(ufl.as_vector(densities), ufl.TestFunction(cellwise))
    sums = fem.assemble_vector(compiled(comm, integrand * dx)).array.reshape(-1, 4).sum(axis=0)
    energy, energy_scale, l2, l2_scale = np.sqrt(comm.allreduce(sums, op=MPI.SUM))
    return FieldError(float(energy / energy_scale), float(l2 / l2_scale))


def fine_quadrature(elasticity: Elasticity) -> int:
    """Degree 2p + 4 of the Gauss rule for smooth non-polynomial functions.  Local."""
    return elasticity.quadrature_degree + 3


def energy_distance(step: Step, values: FloatArray) -> float:
    """Distance ||v - u|| [-] of a displacement v from that of a step, over the energy norm of the step's stress.

    Collective on the step's communicator.  The values (n, (p+1)^3, 3) of v [m] are at the nodes of this rank's leaves.
    """
    elasticity, u, energy = step.elasticity, step.solution.displacement, step.estimate.energy
    assert energy is not None, "kept in a step"
    leaf, node = elasticity.prolongation.space.example.T
    v = elasticity.prolongation.injected(values[leaf, node])
    return float(elasticity.change_norm(v - u) / np.sqrt(step.forest.comm.allreduce(energy.sum())))


@collective("step.forest.comm")
def true_error(step: Step, tolerance: float, scene: Scene | None = None) -> TrueError:
    """Distance of a step from a finer solution of degree 2, computed from it with default settings.

    Collective on the step's communicator.  After a step of degree 1 the first finer space is that of degree 2 on its
    leaves.

    Args:
        tolerance: of the finer solution [-]; half the step's error leaves an eighth of it to the finer estimate.
        scene: with the same root cells and a better geometry; None: the step's own.

    Raises:
        SceneError: no step, a tolerance that is not between `LEAST_TOLERANCE` and 1, no scene or one with
            other root cells.
    """
    check_step(step)
    tolerance = check_tolerance("the tolerance of the finer solution", tolerance)
    finer: Scene = step.scene if scene is None else scene
    marked = np.zeros(len(step.forest), dtype=np.int8)
    if step.record.degree == 2:
        marked[step.leaf_mesh.leaf] = for_tolerance(step.estimate, tolerance, ErrorControl().target, step.forest.comm)
    beginning = Beginning.after(step, marked)
    beginning = replace(beginning, forest=_on(beginning.forest, finer))
    fine = solve(finer, tolerance, step.forest.comm, degree=2, allow=tuple(REFUSED), beginning=beginning)
    distance = energy_distance(fine, fine.carried)
    relative = float(np.hypot(distance, fine.record.estimate))  # errors add in squares (Galerkin orthogonality)
    return TrueError(distance, fine.record.estimate, fine.record.dofs, relative)


def _on(forest: Forest, scene: Scene) -> Forest:
    """The same leaves on the root mesh of a scene."""
    check_scene(scene)
    # The corners of meshes of two orders differ by Gmsh's rounding, 1e-9; those of other meshes by parts of a cell.
    here, there = (mesh.points[mesh.corners] for mesh in (forest.mesh, scene.mesh))
    if here.shape != there.shape or np.abs(here - there).max() > 1e-6 * np.ptp(here, axis=(0, 1)).max():
        raise SceneError("the over-refined solution needs a scene with the same root cells, in the same order")
    surfaces, lattice = scene.contact_surfaces, Lattice(scene.mesh)
    return replace(forest, mesh=scene.mesh, lattice=lattice, pairing=scene.pairing, contact_surfaces=surfaces)
