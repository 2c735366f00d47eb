"""The user's choice of how penetration is resisted.

Closed rows have B u = D.  A penalty lets them penetrate by their force over k_N (1); an augmented Lagrangian adds the
force that is missing (J. C. Simo, T. A. Laursen, Comput. Struct. 42(1), 1992); elimination enforces them exactly.
"""

from dataclasses import dataclass

from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_name, check_number

#: The methods, the default first.
METHODS = ("exact", "augmented-lagrangian", "penalty")

#: Factor of the penalty if none is given: the penetration is 1/100 of the approach that the pressure, over a facet,
#: makes of a half-space.
FACTOR = 100.0
#: Gap tolerance of the augmented Lagrangian if none is given: a hundred times the solver's default tolerance.
GAP_TOLERANCE = 1e-6
#: Least and largest factor.  Softer springs let bodies through each other; penetrations below 1e-12 of the approach are
#: rounding.
SOFTEST, STIFFEST = 1e-3, 1e12
#: Factor of the springs in the matrix across rows that a projection constrains: those of stiffer springs, and all of
#: exact contact.  Softer ones tell the preconditioner too little of contact, stiffer ones couple the directions of
#: oblique normals, which BoomerAMG does not see.  Measured by studies/cost/contact_constants.py.
HELD = 10.0


@dataclass(frozen=True)
class Enforcement:
    """How penetration is resisted.

    Attributes:
        method: "exact": closed rows are eliminated, there is no penetration, the contact force is the residual;
            "augmented-lagrangian": forces are added to those of the penalty until the penetration is below
            `gap_tolerance`;
            "penalty": the force is k_N times the penetration, as in equation (1).
        factor: c of the surface stiffness c E*/h [-], consistent under refinement, h the size of the facet; None: 100.
        node_stiffness: k_N [N/m], the same for every node pair as in equation (1), instead of a factor.
        gap_tolerance: largest penetration that the augmented Lagrangian leaves, relative to the approach of the bodies
            [-]: the least of energy over contact force, largest displacement, and F / (E* A^(1/2)) of the contact pair.

    Raises:
        SceneError: an unknown method, a value that is not positive, a penalty or a gap tolerance where the method takes
            none, a factor and a node_stiffness, a factor that is not between `SOFTEST` and `STIFFEST`, a gap_tolerance
            that is not below 1.
    """

    method: str = METHODS[0]
    factor: float | None = None
    node_stiffness: float | None = None
    gap_tolerance: float = GAP_TOLERANCE

    def __post_init__(self):
        check_name("enforcement", self.method, METHODS)
        for name in ("factor", "node_stiffness", "gap_tolerance"):
            value = getattr(self, name)
            if value is None and name != "gap_tolerance":
                continue
            object.__setattr__(self, name, check_number(f"the penalty {name}", value, positive=True))
        given = [name for name in ("factor", "node_stiffness") if getattr(self, name) is not None]
        if given and self.method == "exact":
            raise SceneError(
                f"the enforcement 'exact' takes no penalty {given[0]}; the methods 'penalty' and others do"
            )
        if not SOFTEST <= (self.factor or FACTOR) <= STIFFEST:
            raise SceneError(
                f"a penalty factor must lie between {SOFTEST:g} and {STIFFEST:g}, got {self.factor:g}: softer ones let "
                "bodies through each other, the penetrations of stiffer ones are rounding; "
                f"{FACTOR:g} is enough, and the enforcement 'exact' needs none"
            )
        if len(given) == 2:
            raise SceneError("a penalty has a factor or a node_stiffness, not both")
        if self.gap_tolerance != GAP_TOLERANCE and self.method != "augmented-lagrangian":
            raise SceneError(
                f"the enforcement {self.method!r} takes no gap_tolerance; 'augmented-lagrangian' does, whose "
                "penetrations become smaller with each augmentation"
            )
        if self.gap_tolerance >= 1:
            raise SceneError(
                f"gap_tolerance is relative to the approach and must be below 1, got {self.gap_tolerance:g}: "
                f"{GAP_TOLERANCE:g} is the default"
            )

    @property
    def springs(self):
        """Factor of the springs of rows, in exact contact of those in the matrix [-].  Local."""
        return self.factor or (HELD if self.method == "exact" else FACTOR)
