"""The true error of a step, against a solution on a forest refined from its own."""

from dataclasses import dataclass, replace

import numpy as np

from fx_contact.adaptive.adaptive_loop import Beginning, adapt
from fx_contact.adaptive.step import check_step, check_tolerance
from fx_contact.estimate.error_control import ErrorControl
from fx_contact.estimate.marking import for_tolerance
from fx_contact.parallel.errors import SceneError
from fx_contact.problem.lattice import Lattice
from fx_contact.problem.scene import check_scene
from fx_contact.results.accuracy import energy_distance


@dataclass(frozen=True)
class TrueError:
    """What an over-refined solution says about a step.

    Attributes:
        distance: norm of u_h - u_fine over that of u_fine, both on the finer mesh [-].
        fine_estimate: estimated error of u_fine [-].
        fine_dofs: unknowns of u_fine.
    """

    distance: float
    fine_estimate: float
    fine_dofs: int

    @property
    def relative(self):
        """True relative energy error of the step [-].

        The finer solution is closest to the exact one among all on its mesh, so that the squares add up (Galerkin
        orthogonality; contact and penalty disturb it by less than the estimate's own error).
        """
        return float(np.hypot(self.distance, self.fine_estimate))


def true_error(step, tolerance, scene=None):
    """Go on from a step to a finer solution with the default settings, and measure the distance to it.

    Collective on the step's communicator.  The step's displacement goes along from leaf to leaf: interpolation onto
    the finer forest, exact in the coordinates of the leaves.

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
    marked[step.leaf_mesh.leaf], _ = for_tolerance(step.estimate, tolerance, None, ErrorControl(), step.forest.comm)
    beginning = Beginning.after(step, marked)
    beginning = replace(beginning, forest=_on(beginning.forest, scene))
    for fine in adapt(scene, tolerance, step.forest.comm, beginning=beginning):
        pass
    distance = energy_distance(fine.elasticity, fine.forest, fine.along)
    return TrueError(distance, fine.record["estimate"], fine.record["dofs"])


def _on(forest, scene):
    """The same leaves on the root mesh of a scene."""
    check_scene(scene)
    here, there = (mesh.points[mesh.corners] for mesh in (forest.mesh, scene.mesh))
    if here.shape != there.shape or np.abs(here - there).max() > 1e-6 * np.ptp(here, axis=(0, 1)).max():
        raise SceneError("the over-refined solution needs a scene with the same root cells, in the same order")
    return replace(forest, mesh=scene.mesh, lattice=Lattice(scene.mesh), pairing=scene.pairing)
