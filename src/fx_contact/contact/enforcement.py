"""Enforcement of contact: closed rows have B u = D, or penetrate by their force over k_N (1)."""

from dataclasses import dataclass

from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_name, check_number

#: The methods, the default first.
METHODS = ("exact", "penalty")

#: Default factor: the penetration is 1/100 of the approach of a half-space by the pressure over a facet.
FACTOR = 100.0
#: Least and largest factor: softer penalties let bodies pass, penetrations below 1e-12 of the approach are rounding.
SOFTEST, STIFFEST = 1e-3, 1e12
#: Factor in the preconditioner matrix in exact contact, its cap for a penalty: a projection constrains stiffer rows.
#: Smaller ones miss the coupling of the bodies, larger ones couple the directions of oblique normals, which BoomerAMG
#: ignores (studies/cost/contact_constants.py).
CAP = 10.0


@dataclass(frozen=True)
class Enforcement:
    """Method and stiffness by which contact resists penetration.

    Attributes:
        method: "exact": no penetration, the contact force is the residual; "penalty": k_N times the penetration (1).
        factor: c of the surface stiffness c E*/h, h the size of the facet, consistent under refinement [-]; None: 100.
        node_stiffness: k_N [N/m] of every node pair as in (1), instead of a factor.

    Raises:
        SceneError: an unknown method, a penalty in exact contact, both a factor and a node_stiffness, values that are
            not positive, a factor beyond `SOFTEST` and `STIFFEST`.
    """

    method: str = METHODS[0]
    factor: float | None = None
    node_stiffness: float | None = None

    def __post_init__(self) -> None:
        if self.method == "augmented-lagrangian":
            raise SceneError(
                "the enforcement 'augmented-lagrangian' no longer exists: take 'exact', which has no parameter and "
                "costs the same, or 'penalty'"
            )
        check_name("enforcement", self.method, METHODS)
        given = [name for name in ("factor", "node_stiffness") if getattr(self, name) is not None]
        for name in given:
            value = check_number(f"the penalty {name}", getattr(self, name), positive=True)
            object.__setattr__(self, name, value)
        if given and self.method == "exact":
            raise SceneError(f"the enforcement 'exact' takes no penalty {given[0]}; 'penalty' does")
        if not SOFTEST <= (self.factor or FACTOR) <= STIFFEST:
            raise SceneError(
                f"a penalty factor must lie between {SOFTEST:g} and {STIFFEST:g}, got {self.factor:g}: softer ones let "
                "bodies through each other, the penetrations of stiffer ones are rounding; "
                f"{FACTOR:g} is enough, and the enforcement 'exact' needs none"
            )
        if len(given) == 2:
            raise SceneError("a penalty has a factor or a node_stiffness, not both")

    @property
    def penalty_factor(self) -> float:
        """c of the rows' stiffness, in exact contact that in the preconditioner matrix [-].  Local."""
        return self.factor or (CAP if self.method == "exact" else FACTOR)
