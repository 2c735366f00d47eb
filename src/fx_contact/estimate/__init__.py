"""How large the error is, where, and what to refine for it; `ErrorControl` is the user's choice of it.

Of the whole: `stress_recovery`, `estimator` of xi_T (3), `effectivity` of xi, `marking`, and `error_control`, which
decides.  Of `quantities`: `goal_errors`, by adjoint solutions (`dual_weighted`); forces of contact pairs are goals of
every run (`contact_goals`, with `inter_node_gap`).  `equilibrium` checks the solver, `stress_projection` is for users.
"""

from fx_contact.estimate.effectivity import RefinementHistory
from fx_contact.estimate.error_control import ErrorControl
from fx_contact.estimate.estimator import Estimate, Estimator

__all__ = ["ErrorControl", "Estimate", "Estimator", "RefinementHistory"]
