"""How large the error is, where, and what to refine for it; `ErrorControl` is the user's choice of it.

Of the whole: `recovery` of stresses and xi_T (3), `effectivity` of xi, `marking`, and `error_control`, which decides.
Of contact: `contact_goals`, which calls `inter_node_gap` and the dual solutions of `dual_weighted`.
`equilibrium` checks the solver.
"""

from fx_contact.estimate.effectivity import RefinementHistory
from fx_contact.estimate.error_control import ErrorControl
from fx_contact.estimate.recovery import Estimate, Recovery

__all__ = ["ErrorControl", "Estimate", "Recovery", "RefinementHistory"]
