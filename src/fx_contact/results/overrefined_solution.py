"""The true error of a step, against a solution on a forest refined from its own."""

from dataclasses import replace

import numpy as np

from fx_contact.adaptive.adaptive_loop import adapt
from fx_contact.adaptive.beginning import Beginning
from fx_contact.adaptive.settings import check_tolerance
from fx_contact.adaptive.step import check_step
from fx_contact.adaptive.step_record import TrueError
from fx_contact.adaptive.validity import REFUSED
from fx_contact.estimate.error_control import ErrorControl
from fx_contact.estimate.marking import for_tolerance
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.meeting import collective
from fx_contact.problem.lattice import Lattice
from fx_contact.problem.scene import check_scene
from fx_contact.results.accuracy import energy_distance

#: Of over-refined solutions.
DEGREE = 2


@collective("step.forest.comm")
def true_error(step, tolerance, scene=None):
    """Go on from a step to a finer solution of degree 2, by default settings else, and measure the distance to it.

    Collective on the step's communicator.  The step's displacement goes along from leaf to leaf: interpolation onto
    the finer forest, exact in the coordinates of the leaves.  After a step of degree 1 the first finer space is that of
    degree 2 on its own leaves.

    Args:
        step: Step.
        tolerance: of the finer solution [-]; half the step's error leaves the fine solution an eighth to say.
        scene: Scene whose root cells are those of the step's scene with a better geometry; None: the step's own.

    Returns:
        TrueError.

    Raises:
        SceneError: no step, a tolerance that is no positive number or below `LEAST_TOLERANCE`, no scene or one with
            other root cells.
    """
    check_step(step)
    tolerance = check_tolerance("the tolerance of the finer solution", tolerance)
    scene = step.scene if scene is None else scene
    marked = np.zeros(len(step.forest), dtype=np.int8)
    if step.record.degree == DEGREE:
        marked[step.leaf_mesh.leaf], _ = for_tolerance(
            step.estimate, tolerance, None, ErrorControl(), step.forest.comm
        )
    beginning = Beginning.after(step, marked)
    beginning = replace(beginning, forest=_on(beginning.forest, scene))
    for fine in adapt(scene, tolerance, step.forest.comm, degree=DEGREE, allow=tuple(REFUSED), beginning=beginning):
        pass
    distance = energy_distance(fine, fine.along)
    # Energy errors add in squares (Galerkin orthogonality), up to contact and penalty, which disturb it by less than
    # the estimate's own error.
    relative = float(np.hypot(distance, fine.record.estimate))
    return TrueError(distance, fine.record.estimate, fine.record.dofs, relative)


def _on(forest, scene):
    """The same leaves on the root mesh of a scene."""
    check_scene(scene)
    # A mesh of another order has other corners by Gmsh's rounding, 1e-9; another mesh by parts of a cell.
    here, there = (mesh.points[mesh.corners] for mesh in (forest.mesh, scene.mesh))
    if here.shape != there.shape or np.abs(here - there).max() > 1e-6 * np.ptp(here, axis=(0, 1)).max():
        raise SceneError("the over-refined solution needs a scene with the same root cells, in the same order")
    surfaces = {"pairing": scene.pairing, "contact_surfaces": scene.contact_surfaces}
    return replace(forest, mesh=scene.mesh, lattice=Lattice(scene.mesh), **surfaces)
