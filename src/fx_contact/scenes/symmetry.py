"""Lateral supports of quarter models and of whole bodies."""

from collections.abc import Sequence

from fx_contact.items.boundary_conditions import Dirichlet, SymmetryPlane


def sideways(symmetry: str, bodies: Sequence[str], line: str = "side") -> tuple[Dirichlet | SymmetryPlane, ...]:
    """Conditions against rigid motion along x and y: symmetry planes, or for whole bodies two lines on each.

    Local.  Of a "quarter" the surfaces "x = 0" and "y = 0", of "full" bodies the curves "BODY axis" and, in the plane
    y = 0, "BODY LINE".  Single vertices would support so softly that PCG needs twice the iterations.
    """
    if symmetry == "quarter":
        return SymmetryPlane("x = 0"), SymmetryPlane("y = 0")
    return tuple(
        condition
        for body in bodies
        for condition in (Dirichlet(f"{body} axis", x=0.0, y=0.0), Dirichlet(f"{body} {line}", y=0.0))
    )
