"""Checks that the ready scenes share."""

import math

import numpy as np

from fx_contact.parallel.errors import GeometryError, SceneError
from fx_contact.parallel.validation import check_count, check_number, shown
from fx_contact.problem.materials import Material
from fx_contact.problem.root_mesh_checks import MAX_ORDER, SMALLEST

#: Most root cells along a block: the root mesh is replicated on every rank.
_MOST = 50


def check_mesh_size(order, coarse):
    """Raises GeometryError for an order outside 1 to 6, SceneError unless coarse is a number of root cells.  Local."""
    if isinstance(order, bool) or not isinstance(order, int) or order not in range(1, MAX_ORDER + 1):
        raise GeometryError(f"the order of the root mesh must be 1 to {MAX_ORDER}, got {shown(order)}")
    check_count("coarse, the number of root cells,", coarse)
    if coarse > _MOST:
        raise SceneError(
            f"coarse must be {_MOST} at most, got {coarse}: refinement makes the leaves, not the root mesh"
        )


def check_length(what, value):
    """Raises SceneError unless a value is a positive number, GeometryError for lengths no mesh can have.  Local."""
    if not SMALLEST < (length := check_number(what, value, positive=True)) < 1 / SMALLEST:
        raise GeometryError(f"{what} is {length:.3g} m, volumes of such a size are no numbers: check the units")


def check_list(what, values, count=None):
    """Raises SceneError unless values are a tuple, list or array, of so many.  Local."""
    listed = isinstance(values, (tuple, list)) or (isinstance(values, np.ndarray) and values.ndim == 1)
    if not listed or count not in (None, len(values)):
        raise SceneError(f"{what} must be a tuple{'' if count is None else f' of {count}'}, got {shown(values)}")


def check_material(what, value):
    """Raises SceneError unless a value is a Material.  Local."""
    if not isinstance(value, Material):
        raise SceneError(f"{what} must be a Material, got {shown(value)}")


def check_cells(cells, blocks=1):
    """Raises SceneError unless cells, those along x, y, z of a block, are not too many for a root mesh.  Local."""
    check_list("cells, the numbers of root cells along x, y, z,", cells, 3)
    for count in cells:
        check_count("the number of root cells along x, y or z", count)
    total = blocks * math.prod(cells)
    if total > _MOST**3:
        raise SceneError(f"{total:,} root cells are too many: refinement makes the leaves, not the root mesh")
