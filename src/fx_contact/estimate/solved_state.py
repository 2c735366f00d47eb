"""The solution of a step, for estimates of its error."""

from dataclasses import dataclass

from fx_contact.contact.constraint_rows import ConstraintRows
from fx_contact.estimate.estimator import Estimate
from fx_contact.fem.displacement_field import DisplacementField
from fx_contact.fem.elasticity import Elasticity
from fx_contact.forest.forest import Forest
from fx_contact.law.contact_solver import ContactSolution
from fx_contact.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class SolvedState:
    """A scene solved on a forest, and the estimated error; a Step has these attributes too.

    Attributes:
        field: u at all nodes [m].
        rows: normals of all contacts; None without contact.  All rows, with tangents and equations: `solution.rows`.
    """

    scene: Scene
    forest: Forest
    elasticity: Elasticity
    field: DisplacementField
    rows: ConstraintRows | None
    solution: ContactSolution
    estimate: Estimate

    @property
    def contact_rows(self) -> ConstraintRows:
        """`rows`, of a scene with contact.  Local."""
        assert self.rows is not None, "of a scene with contact"
        return self.rows
