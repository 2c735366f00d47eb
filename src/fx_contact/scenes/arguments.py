"""Checks that the ready scenes share."""

import numpy as np

from fx_contact.errors import GeometryError, SceneError
from fx_contact.rootmesh import MAX_ORDER


def check_symmetry(symmetry):
    """Raises SceneError unless symmetry is "quarter" or "full".  Local."""
    if symmetry not in ("quarter", "full"):
        raise SceneError(f"unknown symmetry {symmetry!r}; there are 'quarter' and 'full'")


def check_number(name, value, positive=False):
    """Raises SceneError unless a number is finite, and positive if asked for.  Local."""
    if not np.isfinite(value) or (positive and value <= 0):
        raise SceneError(f"the {name} must be a {'positive' if positive else 'finite'} number, got {value}")


def check_mesh_size(order, coarse):
    """Raises GeometryError for an order outside 1 to 6, SceneError unless coarse is a positive integer.  Local."""
    if order not in range(1, MAX_ORDER + 1):
        raise GeometryError(f"the order of the root mesh must be 1 to {MAX_ORDER}, got {order}")
    if not (isinstance(coarse, (int, np.integer)) and coarse >= 1):
        raise SceneError(f"coarse must be a positive number of root cells, got {coarse}")
