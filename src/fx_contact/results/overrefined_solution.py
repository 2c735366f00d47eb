"""True error of a step, against a solution on a refinement of its forest."""

from dataclasses import replace

import numpy as np

from fx_contact.adaptive.adaptive_loop import adapt
from fx_contact.adaptive.beginning import Beginning
from fx_contact.adaptive.settings import check_tolerance
from fx_contact.adaptive.step import Step, check_step
from fx_contact.adaptive.step_record import TrueError
from fx_contact.adaptive.validity import REFUSED
from fx_contact.estimate.error_control import ErrorControl
from fx_contact.estimate.marking import for_tolerance
from fx_contact.forest.forest import Forest
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.meeting import collective
from fx_contact.problem.lattice import Lattice
from fx_contact.problem.scene import Scene, check_scene
from fx_contact.results.accuracy import energy_distance


@collective("step.forest.comm")
def true_error(step: Step, tolerance: float, scene: Scene | None = None) -> TrueError:
    """Distance of a step from a finer solution of degree 2, computed from it with default settings.

    Collective on the step's communicator.  After a step of degree 1 the first finer space is that of degree 2 on its
    leaves.

    Args:
        tolerance: of the finer solution [-]; half the step's error leaves an eighth of it to the finer estimate.
        scene: with the same root cells and a better geometry; None: the step's own.

    Raises:
        SceneError: no step, a tolerance that is no positive number or below `LEAST_TOLERANCE`, no scene or one with
            other root cells.
    """
    check_step(step)
    tolerance = check_tolerance("the tolerance of the finer solution", tolerance)
    finer: Scene = step.scene if scene is None else scene
    marked = np.zeros(len(step.forest), dtype=np.int8)
    if step.record.degree == 2:
        chosen, _ = for_tolerance(step.estimate, tolerance, None, ErrorControl(), step.forest.comm)
        marked[step.leaf_mesh.leaf] = chosen
    beginning = Beginning.after(step, marked)
    beginning = replace(beginning, forest=_on(beginning.forest, finer))
    for fine in adapt(finer, tolerance, step.forest.comm, degree=2, allow=tuple(REFUSED), beginning=beginning):
        pass
    distance = energy_distance(fine, fine.carried)
    # Energy errors add in squares (Galerkin orthogonality); contact and penalty disturb it by less than the error of
    # the estimate.
    relative = float(np.hypot(distance, fine.record.estimate))
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
