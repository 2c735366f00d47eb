"""Equilibrium of each body from its stresses: a check of the solver."""

import numpy as np

from fx_contact.estimate.solved_state import SolvedState
from fx_contact.fem.supports import Supports
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import SolveError
from fx_contact.parallel.validation import percent

#: Largest unbalanced share of the forces [-]: the error e^2 of a force at a tolerance e of 7 %.  Ready scenes, solved
#: to 1e-13, leave 1e-10 (`tests/verdict/test_resultants.py`).
MOST = 0.005
#: The part of reactions that counts: sums of magnitudes at many nodes, they may be mostly rounding.
_REACTIONS = 0.01
#: Advice of messages.
WHERE_ROUNDING_IS_LARGE = (
    "bodies that come from afar must begin closer to each other; thin ones that are nearly incompressible need a "
    "smaller Poisson's ratio"
)


def nodal_residual(state: SolvedState, load: FloatArray) -> FloatArray:
    """int sigma : grad v - L + B^T f, (owned, 3) [N], external forces L: reactions, else the error of the solver.

    Collective on state.forest.comm.
    """
    residual: FloatArray = state.elasticity.internal_forces(state.field) - load
    if state.solution.rows is not None:
        residual += state.solution.rows.transposed(state.solution.row_force)
    return residual


def unbalanced(state: SolvedState, residual: FloatArray, load: FloatArray, supports: Supports) -> float:
    """Largest unbalanced force on a body over max(contact forces, loads, reactions / 100), sums of magnitudes [-].

    Collective on state.forest.comm.  Loads, contact forces and reactions add up to the residuals in free directions.

    Args:
        residual: (owned, 3), `nodal_residual` of the state [N].
        load: (owned, 3), external forces and those of stress-free strains [N].
    """
    forest, prolongation, free = state.forest, state.elasticity.prolongation, supports.free_part(residual)
    body = prolongation.injected(forest.mesh.body[forest.cell[prolongation.space.example[:, 0]]])
    sums = np.zeros((len(forest.mesh.bodies) + 1, 3))
    np.add.at(sums, body, free)
    sums[-1] = state.solution.force.sum(), np.abs(load).sum(), _REACTIONS * np.abs(residual - free).sum()
    sums = forest.comm.allreduce(sums)
    return float(np.linalg.norm(sums[:-1], axis=1).max() / sums[-1].max()) if sums[-1].any() else 0.0


def check_balance(state: SolvedState, residual: FloatArray, load: FloatArray, supports: Supports) -> None:
    """Check the balance by `unbalanced`; rounding disturbs it for bodies that begin far apart.

    Collective on state.forest.comm.  Raises SolveError: more than `MOST` is not balanced.
    """
    left = unbalanced(state, residual, load, supports)
    if left > MOST:
        raise SolveError(
            f"linear solver and rounding leave {percent(left)} of the forces on a body unbalanced: "
            f"{WHERE_ROUNDING_IS_LARGE}"
        )
