"""How closed pairs are kept from overlapping: the methods by name, and their algebra on the conforming unknowns.

With B the jump of the displacement across the node pairs along their normals and D their initial gaps, closed pairs
have B u = D.  A penalty lets them overlap by what their force takes (1); an augmented Lagrangian adds the force that is
missing (J. C. Simo, T. A. Laursen, Comput. Struct. 42(1), 1992); elimination holds them exactly.
"""

from dataclasses import dataclass

from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_name, check_number

#: The methods, the default first.
METHODS = ("exact", "augmented-lagrangian", "penalty")

#: The factor of the penalty where none is given.
FACTOR = 100.0
#: The gap tolerance of the augmented Lagrangian where none is given.
GAP_TOLERANCE = 1e-6
#: The least and the largest: beside the bodies softer ones are nothing, and the overlaps of stiffer ones are rounding.
SOFTEST, STIFFEST = 1e-3, 1e12
#: The factor of the springs that a matrix has for pairs that are held otherwise: with softer ones its preconditioner
#: knows too little of contact, stiffer ones couple directions where normals lie along no axis, unseen by BoomerAMG.
HELD = 10.0
#: Factor above which a penalty's springs stay beside the matrix, and closed pairs are held: up to here the matrix that
#: has them is as easy to precondition, but where normals lie along no axis.
STIFF = 2 * FACTOR


@dataclass(frozen=True)
class Enforcement:
    """How penetration is resisted.

    Attributes:
        method: "exact": closed pairs are eliminated, no penetration, the contact force is the residual;
            "augmented-lagrangian": forces are added to the penalty's until the penetration is below `gap_tolerance`;
            "penalty": the force is k_N times the penetration, as in equation (1).
        factor: c of the surface stiffness c E*/h [-], consistent under refinement, h the size of the facet; None: 100.
        node_stiffness: k_N [N/m], the same for every node pair as in equation (1), instead of a factor.
        gap_tolerance: largest penetration that the augmented Lagrangian leaves, relative to the approach of the bodies
            [-]: to the energy over the contact force, to the largest displacement, and to how far a punch with the
            force and area of the contact pair would come.

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
                "bodies through each other, the overlaps of stiffer ones are rounding; "
                f"{FACTOR:g} is enough, and the enforcement 'exact' needs none"
            )
        if len(given) == 2:
            raise SceneError("a penalty has a factor or a node_stiffness, not both")
        if self.gap_tolerance != GAP_TOLERANCE and self.method != "augmented-lagrangian":
            raise SceneError(
                f"the enforcement {self.method!r} takes no gap_tolerance; 'augmented-lagrangian' does, whose overlaps "
                "become smaller with each augmentation"
            )
        if self.gap_tolerance >= 1:
            raise SceneError(
                f"gap_tolerance is relative to the approach and must be below 1, got {self.gap_tolerance:g}: "
                f"{GAP_TOLERANCE:g} is the default"
            )

    @property
    def springs(self):
        """The factor of the springs between the pairs, those in the matrix of exact contact too [-].  Local."""
        return self.factor or (HELD if self.method == "exact" else FACTOR)
