"""Lateral supports of quarter models and of whole bodies."""

from collections.abc import Sequence

from fx_contact.problem.boundary_conditions import Dirichlet, SymmetryPlane


def sideways(symmetry: str, bodies: Sequence[str], line: str = "side") -> tuple[Dirichlet | SymmetryPlane, ...]:
    """Conditions against rigid motion along x and y: symmetry planes, or for whole bodies two lines on each.

    Local.  Single vertices would suffice, but support so softly that PCG needs twice the iterations.

    Args:
        symmetry: "quarter": the surfaces "x = 0" and "y = 0"; "full": the curves "BODY axis" and "BODY LINE", where the
            lateral displacement is zero by symmetry.
        bodies: names.
        line: name of the second curve, in the plane y = 0.
    """
    if symmetry == "quarter":
        return SymmetryPlane("x = 0"), SymmetryPlane("y = 0")
    return tuple(
        condition
        for body in bodies
        for condition in (Dirichlet(f"{body} axis", x=0.0, y=0.0), Dirichlet(f"{body} {line}", y=0.0))
    )
