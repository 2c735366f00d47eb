"""Equilibrium of each body, from its stresses: a check of a solution whatever solver has found it."""

import numpy as np

from fx_contact.estimate.solved_state import SolvedState
from fx_contact.fem.supports import Supports
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import SolveError
from fx_contact.parallel.validation import percent

#: Largest unbalanced share of the forces [-]: the error e^2 of a force at a tolerance e of 7 %.  Solutions in balance
#: leave the error of the linear solver: 1e-10 on all ready scenes, solved to 1e-13
#: (`tests/adaptive/test_resultants.py`).
MOST = 0.005
#: Reactions count by this part of them, so that 5e-5 of them may be left where nothing else acts: sums of magnitudes at
#: many nodes, they may be rounding for the most part.
_REACTIONS = 0.01
#: What to do where rounding is large, for messages.
WHERE_ROUNDING_IS_LARGE = (
    "bodies that come from afar must begin closer to each other; thin ones that are nearly incompressible need a "
    "smaller Poisson's ratio"
)


def nodal_residual(state: SolvedState, load: FloatArray) -> FloatArray:
    """K u - L + B^T f: the reactions where displacements are prescribed, elsewhere 0 but for the solver's error.

    Collective on state.forest.comm.

    Args:
        load: (owned, 3), external forces L [N].

    Returns:
        (owned, 3), at the conforming nodes, K u integrated from the stresses [N].
    """
    residual: FloatArray = state.elasticity.internal_forces(state.field) - load
    if state.pairs is not None:
        residual += state.pairs.transposed(state.solution.force)
    return residual


def unbalanced(state: SolvedState, residual: FloatArray, load: FloatArray, supports: Supports) -> float:
    """Largest unbalanced share of the forces on a body [-].

    Collective on state.forest.comm.  A body's stresses are in balance by themselves.  Its loads, contact
    forces and reactions add up to the sum of the residuals in free directions.

    Args:
        residual: (owned, 3), `nodal_residual` of the state [N].
        load: (owned, 3), external forces [N].
        supports: at the owned conforming nodes.

    Returns:
        relative to all contact forces or loads, or to a hundredth of the reactions where those are less.
    """
    forest, prolongation, free = state.forest, state.elasticity.prolongation, supports.free_part(residual)
    body = prolongation.injected(forest.mesh.body[forest.cell[prolongation.space.example[:, 0]]])
    sums = np.zeros((len(forest.mesh.bodies) + 1, 3))
    np.add.at(sums, body, free)
    sums[-1] = state.solution.force.sum(), np.abs(load).sum(), _REACTIONS * np.abs(residual - free).sum()
    sums = forest.comm.allreduce(sums)
    return float(np.linalg.norm(sums[:-1], axis=1).max() / sums[-1].max()) if sums[-1].any() else 0.0


def check_balance(state: SolvedState, residual: FloatArray, load: FloatArray, supports: Supports) -> None:
    """Check that the forces on each body are in balance.

    Collective on state.forest.comm.  Bodies that come from afar lose it in rounding, unnoticed by a linear solver whose
    products have lost it too.

    Args:
        state, residual, load, supports: as in `unbalanced`.

    Raises:
        SolveError: more than `MOST` of the forces is not balanced.
    """
    left = unbalanced(state, residual, load, supports)
    if left > MOST:
        raise SolveError(
            f"linear solver and rounding leave {percent(left)} of the forces on a body unbalanced: "
            f"{WHERE_ROUNDING_IS_LARGE}"
        )
