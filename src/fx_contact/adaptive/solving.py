"""The last step of a run."""

from collections.abc import Callable, Sequence
from pathlib import Path

from mpi4py import MPI

from fx_contact.adaptive.adaptive_loop import adapt
from fx_contact.adaptive.beginning import Beginning
from fx_contact.adaptive.checkpoint import Checkpoint
from fx_contact.adaptive.settings import DEGREE
from fx_contact.adaptive.step import Step
from fx_contact.contact.enforcement import Enforcement
from fx_contact.estimate.error_control import ErrorControl
from fx_contact.estimate.quantities import Quantity
from fx_contact.linalg.solver_options import Solver
from fx_contact.parallel.meeting import collective
from fx_contact.scene.scene import Scene


@collective("comm")
def solve(
    scene: Scene,
    tolerance: float,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    *,
    degree: int = DEGREE,
    max_steps: int = 20,
    geometry_order: int | None = None,
    enforcement: Enforcement | None = None,
    solver: Solver | None = None,
    control: ErrorControl | None = None,
    goals: Quantity | Sequence[Quantity] = (),
    partition_kind: str = "contact-sfc",
    allow: str | Sequence[str] = (),
    beginning: Beginning | None = None,
    checkpoint: str | Path | None = None,
    restart: Checkpoint | str | Path | None = None,
    progress: bool | Callable[[int, str], None] | None = None,
) -> Step:
    """Solve a scene to a prescribed accuracy; only the last step is kept.

    Collective on comm.  All arguments but progress must be the same on all ranks.

    Args:
        scene: bodies, materials, conditions, loads and contacts.
        tolerance: largest estimated error of the stress in the energy norm, relative to the solution, below 1 [-].
        comm: of all ranks that solve the scene.
        degree: of the displacements, 1 or 2.
        max_steps: largest number of meshes.
        geometry_order: of the curved cells; None: as high as the tolerance needs.
        enforcement: of contact; None: exact.
        solver: preconditioner and tolerance of the linear solver; None: by default.
        control: mode of refinement and stopping; None: errors of stresses and contact forces.
        goals: quantities with tolerances of their own: ContactForce, Gap, MaxPressure, Displacement, Reaction.
        partition_kind: "contact-sfc", "equidistributed", "sfc" or "graph".
        allow: kinds of model warnings that are no errors here: "large strain", "large rotation", "no load".
        beginning: mesh and displacement to start from; None: the root cells.
        checkpoint: folder for the last step; None: no checkpoints.
        restart: folder of a checkpoint, or a Checkpoint, from which the run continues.
        progress: True shows a live line for each mesh; or a function of the number of the step and the stage.

    Returns:
        the last step; `record.reached` is true where the tolerance and all goals are reached.

    Raises:
        FxContactError: as `adapt`; the record, forest and displacement of the last solved mesh are its attributes.
    """
    return adapt(**locals()).last_step()
