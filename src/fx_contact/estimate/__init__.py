"""Error estimates, and the cells to refine for them; `ErrorControl` is the user's choice.

Energy norm: `stress_recovery`, `estimator` of xi_T (3), `marking`, `error_control`.  Quantities of
interest: `goal_errors` by adjoint solutions (`dual_weighted`); forces of contact pairs are goals of every run.
"""

from fx_contact.estimate.error_control import ErrorControl
from fx_contact.estimate.estimator import Estimate, Estimator

__all__ = ["ErrorControl", "Estimate", "Estimator"]
