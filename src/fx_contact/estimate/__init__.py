"""Error estimates, and the cells to refine for them; `ErrorControl` is the user's choice.

Energy norm: `stress_recovery`, `estimator` of xi_T (3), `effectivity` of xi, `marking`, and the choice of cells,
`error_control`.  Quantities of interest (`quantities`): `goal_errors`, by adjoint solutions (`dual_weighted`); forces
of contact pairs are goals of every run (`contact_goals`, with `inter_node_gap`).  `equilibrium` checks the solver,
`stress_projection` is for users.
"""

from fx_contact.estimate.effectivity import RefinementHistory
from fx_contact.estimate.error_control import ErrorControl
from fx_contact.estimate.estimator import Estimate, Estimator

__all__ = ["ErrorControl", "Estimate", "Estimator", "RefinementHistory"]
