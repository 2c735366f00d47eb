"""Settings of a run, the same in every step."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from numbers import Integral
from typing import Any

from fx_contact.contact.enforcement import Enforcement
from fx_contact.estimate.error_control import ErrorControl
from fx_contact.estimate.goal_errors import check_goals
from fx_contact.estimate.quantities import Quantity
from fx_contact.fem.space import DEGREES
from fx_contact.linalg.solver_options import Solver
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_tolerance, shown
from fx_contact.scene.fingerprint import scene_parts
from fx_contact.scene.scene import Scene, check_scene
from fx_contact.verdict.model_warning import ModelWarning, checked_kinds
from fx_contact.verdict.scene_warnings import warnings_of

#: Default degree of the displacements.
DEGREE = 2
#: Largest deviation of the leaf maps from the root cells' maps, relative to the leaf's shortest length, over the
#: tolerance: it changes strains by about as much, and errors add in squares.
GEOMETRY_SHARE = 0.1


@dataclass(frozen=True, eq=False)
class Settings:
    """Settings of a run.

    Attributes:
        tolerance: prescribed relative error e in the energy norm, (6) [-].
        geometry_order: order of the leaf maps; None: the lowest by `GEOMETRY_SHARE`.
        degree: p of the displacements, 1 or 2.
        allow: kinds of model warnings that are no errors, keys of `model_warning.REFUSED`.
        goals: quantities with tolerances of their own.
        moved_before: `State.moved` of the load step before.

    Raises:
        SceneError: a value of another type, another degree, a tolerance below `LEAST_TOLERANCE` or not below 1, an
            order above that of the root mesh, an unknown kind of warnings.
    """

    scene: Scene
    tolerance: float
    geometry_order: int | None
    enforcement: Enforcement
    solver: Solver
    control: ErrorControl
    degree: int = DEGREE
    allow: str | Sequence[str] = ()
    goals: Sequence[Quantity] = ()
    moved_before: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_scene(self.scene)
        object.__setattr__(self, "goals", check_goals(self.goals, self.scene))
        object.__setattr__(self, "tolerance", check_tolerance("the tolerance", self.tolerance))
        object.__setattr__(self, "allow", checked_kinds(self.allow))
        for name, kind in (("enforcement", Enforcement), ("solver", Solver), ("control", ErrorControl)):
            value = getattr(self, name)
            if not isinstance(value, kind):
                article = "an" if kind.__name__[0] in "AEIOU" else "a"
                advice = f": write {kind.__name__}({shown(value)})" if isinstance(value, str) else ""
                raise SceneError(f"{name} must be {article} {kind.__name__}, got {shown(value)}{advice}")
        if self.enforcement.method != "exact" and any(pair.tangential is not None for pair in self.scene.contact):
            raise SceneError("friction needs the enforcement 'exact', the default: leave the penalty away")
        degree = self._whole(
            "degree", DEGREES, f"the degree of displacements must be {' or '.join(map(str, DEGREES))}"
        )
        if self.solver.preconditioner == "p-multigrid" and degree == 1:
            raise SceneError(
                "the preconditioner 'p-multigrid' solves on degree 1 below displacements of degree 2: at degree 1 take "
                "'boomeramg', the default"
            )
        if self.geometry_order is not None:
            highest = self.scene.mesh.order
            wanted = f"the geometry order must be 1 to {highest}, that of the root mesh"
            self._whole("geometry_order", range(1, highest + 1), wanted)

    def _whole(self, name: str, known: Collection[int], wanted: str) -> int:
        """A field made an int.  Raises SceneError unless it is one of the known whole numbers."""
        value = getattr(self, name)
        if isinstance(value, bool) or not isinstance(value, Integral) or value not in known:
            raise SceneError(f"{wanted}, got {shown(value)}")
        object.__setattr__(self, name, int(value))
        return int(value)

    @property
    def multigrid(self) -> bool:
        """True if the preconditioner needs the level of degree 1.  Local."""
        return self.degree > 1 and self.solver.preconditioner in (None, "p-multigrid")

    @cached_property
    def problem(self) -> dict[str, Any]:
        """`fingerprint.scene_parts` of the scene; functions of the user are called at the first access.  Local."""
        return scene_parts(self.scene)

    @cached_property
    def scene_warnings(self) -> list[ModelWarning]:
        """`scene_warnings.warnings_of` the scene, made once.  Local."""
        return warnings_of(self.scene)

    def fixed(self) -> dict[str, Any]:
        """Settings by name that a restart must not change, beside the problem, as JSON can hold them.  Local."""
        return {
            "degree": self.degree,
            "geometry order": self.geometry_order,
            "enforcement": asdict(self.enforcement),
            **{f"error control's {name}": value for name, value in self.control.used().items()},
        }

    def entries(self) -> dict[str, Any]:
        """All settings by name, as JSON can hold them.  Local."""
        return {
            "scene": self.scene.name,
            **self.problem,
            "tolerance": self.tolerance,
            "allowed warnings": [*self.allow],
            **self.fixed(),
            "goals": [repr(goal) for goal in self.goals],
            **{f"solver's {name}": value for name, value in vars(self.solver).items() if name != "options"},
            **{f"solver's option {name}": value for name, value in self.solver.options.items()},
        }
