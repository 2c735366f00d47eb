"""Equilibrium of each body, from its stresses: a check of a solution whatever solver has found it."""

import numpy as np

from fx_contact.parallel.errors import SolveError
from fx_contact.parallel.validation import percent

#: Most of the forces that may be left unbalanced [-]: what a force may be off at a tolerance of 7 %, e^2.  Solutions in
#: balance leave what the linear solver does: 1e-10 on all ready scenes, solved to 1e-13
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


def nodal_residual(state, load):
    """K u - L + B^T f: the reactions where displacements are prescribed, elsewhere 0 but for the solver's error.

    Collective on state.forest.comm.

    Args:
        state: SolvedState.
        load: (owned, 3) float64, external forces L [N].

    Returns:
        (owned, 3) float64, at the conforming nodes, K u integrated from the stresses [N].
    """
    residual = state.elasticity.internal_forces(state.field) - load
    if state.pairs is not None:
        residual += state.pairs.transposed(state.solution.force)
    return residual


def unbalanced(state, residual, load, supports):
    """Share of the forces that no reaction balances.

    Collective on state.forest.comm.  A body's stresses are in balance by themselves.  What is left of its loads,
    contact forces and reactions is the sum of the residuals in directions that no condition holds.

    Args:
        state: SolvedState.
        residual: (owned, 3) float64, its `nodal_residual` [N].
        load: (owned, 3) float64 external forces [N].
        supports: Supports at the owned conforming nodes.

    Returns:
        float, of the body with the largest share, relative to all contact forces or loads, or to a hundredth
        of the reactions where those are less [-].
    """
    forest, prolongation, free = state.forest, state.elasticity.prolongation, supports.free_part(residual)
    body = prolongation.injected(forest.mesh.body[forest.cell[prolongation.space.example[:, 0]]])
    sums = np.zeros((len(forest.mesh.bodies) + 1, 3))
    np.add.at(sums, body, free)
    sums[-1] = state.solution.force.sum(), np.abs(load).sum(), _REACTIONS * np.abs(residual - free).sum()
    sums = forest.comm.allreduce(sums)
    return float(np.linalg.norm(sums[:-1], axis=1).max() / sums[-1].max()) if sums[-1].any() else 0.0


def check_balance(state, residual, load, supports):
    """See that a solution is in balance.

    Collective on state.forest.comm.  Bodies that come from afar lose it in rounding, unnoticed by a linear solver whose
    products have lost it too.

    Args:
        state, residual, load, supports: as `unbalanced` takes them.

    Raises:
        SolveError: more than `MOST` of the forces is not balanced.
    """
    left = unbalanced(state, residual, load, supports)
    if left > MOST:
        raise SolveError(
            f"linear solver and rounding leave {percent(left)} of the forces on a body unbalanced: "
            f"{WHERE_ROUNDING_IS_LARGE}"
        )
