"""Argument checks shared by the ready scenes."""

from collections.abc import Mapping

from fx_contact.geometry.root_mesh_checks import MAX_ORDER, SMALLEST
from fx_contact.parallel.errors import GeometryError, SceneError
from fx_contact.parallel.validation import check_count, check_name, check_number, shown

#: Largest number of root cells along a block: the root mesh is replicated on every rank.
MOST_CELLS = 50


def check_arguments(
    order: int,
    coarse: int,
    lengths: Mapping[str, float],
    numbers: Mapping[str, float],
    symmetry: str = "full",
    least_order: int = 1,
    even: bool = False,
) -> None:
    """Check the order and the cells of a root mesh, and named positive lengths and finite numbers.

    Local.  The least order is 2 if straight cells would make another body; `coarse` is even for a vertex on the axis.

    Raises:
        GeometryError: an order out of range, or a length whose volume is no double precision number.
        SceneError: another argument out of range.
    """
    check_name("symmetry", symmetry, ("quarter", "full"))
    for what, value in lengths.items():
        if not SMALLEST < (length := check_number(what, value, positive=True)) < 1 / SMALLEST:
            raise GeometryError(f"{what} is {length:.3g}, volumes of such a size are no numbers: check the units")
    for what, value in numbers.items():
        check_number(what, value)
    if isinstance(order, bool) or order not in range(least_order, MAX_ORDER + 1):
        raise GeometryError(f"the order of the root mesh must be {least_order} to {MAX_ORDER}, got {shown(order)}")
    check_count("coarse, the number of root cells,", coarse)
    if coarse > MOST_CELLS or even and coarse % 2:
        raise SceneError(
            f"coarse must be {'even and ' * even}{MOST_CELLS} at most, got {coarse}: refinement makes the leaves"
        )
