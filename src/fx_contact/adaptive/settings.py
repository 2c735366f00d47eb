"""What is asked of every step of a run."""

from dataclasses import asdict, dataclass
from functools import cached_property
from numbers import Integral

from fx_contact.adaptive.validity import check_allowed
from fx_contact.contact.enforcement import Enforcement
from fx_contact.estimate.error_control import ErrorControl
from fx_contact.estimate.quantities import check_goals
from fx_contact.fem.space import DEGREES
from fx_contact.linalg.solver_options import Solver
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_number, shown
from fx_contact.problem.fingerprint import scene_parts
from fx_contact.problem.scene import Scene, check_scene

#: Degree of the displacements where none is given.
DEGREE = 2
#: Share of the prescribed error that the leaf maps may deviate from the root cells' maps, relative to the leaf's
#: shortest length, where the program chooses the geometry order: a leaf that is off by a part d of it has strains off
#: by about d, and a tenth adds 0.5 % of the error, in squares.
GEOMETRY_SHARE = 0.1
#: Smallest tolerance: below it rounding is most of the error, on any mesh that fits into a memory.
LEAST_TOLERANCE = 1e-9


def check_tolerance(what, value):
    """A prescribed error as a float.  Raises SceneError unless it is a positive number, and rounding lets it be met."""
    tolerance = check_number(what, value, positive=True)
    if tolerance < LEAST_TOLERANCE:
        raise SceneError(
            f"{what} must be at least {LEAST_TOLERANCE:g}, got {tolerance:g}: below that rounding is most of the "
            "error, so that no mesh reaches it"
        )
    return tolerance


@dataclass(frozen=True, eq=False)
class Settings:
    """What is asked of every step of a run.

    Attributes:
        scene: Scene.
        tolerance: prescribed relative error e in the energy norm, (6) [-].
        geometry_order: order of the leaf maps; None: the lowest that holds the root map to `GEOMETRY_SHARE` times the
            tolerance.
        enforcement: Enforcement of the contact conditions.
        solver: Solver.
        control: ErrorControl.
        degree: p of the displacements, 1 or 2.
        allow: kinds of doubts that are no errors, keys of `validity.REFUSED`.
        goals: tuple of Quantity, held to tolerances of their own.

    Raises:
        SceneError: a value of another type, another degree, a tolerance below `LEAST_TOLERANCE` or not below 1, an
            order above that of the root mesh, an unknown kind of doubts.
    """

    scene: Scene
    tolerance: float
    geometry_order: int | None
    enforcement: Enforcement
    solver: Solver
    control: ErrorControl
    degree: int = DEGREE
    allow: tuple[str, ...] = ()
    goals: tuple = ()

    def __post_init__(self):
        check_scene(self.scene)
        object.__setattr__(self, "goals", check_goals(self.goals, self.scene))
        tolerance = check_tolerance("the tolerance", self.tolerance)
        object.__setattr__(self, "tolerance", tolerance)
        order, orders = self.geometry_order, range(1, self.scene.mesh.order + 1)
        if tolerance >= 1:
            raise SceneError(f"the tolerance is relative and must be below 1, got {tolerance}: 4 % are 0.04")
        for name, kind in (("enforcement", Enforcement), ("solver", Solver), ("control", ErrorControl)):
            if not isinstance(getattr(self, name), kind):
                value, article = getattr(self, name), "an" if kind.__name__[0] in "AEIOU" else "a"
                advice = f": write {kind.__name__}({shown(value)})" if isinstance(value, str) else ""
                raise SceneError(f"{name} must be {article} {kind.__name__}, got {shown(value)}{advice}")
        degree = self.degree
        if isinstance(degree, bool) or not isinstance(degree, Integral) or degree not in DEGREES:
            raise SceneError(
                f"the degree of displacements must be {' or '.join(map(str, DEGREES))}, got {shown(degree)}"
            )
        object.__setattr__(self, "degree", int(degree))
        if self.solver.preconditioner == "p-multigrid" and degree == 1:
            raise SceneError(
                "the preconditioner 'p-multigrid' solves on degree 1 below displacements of degree 2: at degree 1 take "
                "'boomeramg', the default"
            )
        check_allowed(self.allow)
        if order is None:
            return
        if isinstance(order, bool) or not isinstance(order, Integral) or order not in orders:
            raise SceneError(
                f"the geometry order must be 1 to {orders[-1]}, that of the root mesh, got {shown(order)}"
            )
        object.__setattr__(self, "geometry_order", int(order))

    @property
    def multigrid(self):
        """Whether the preconditioner needs the level of degree 1.  Local."""
        return self.degree > 1 and self.solver.preconditioner in (None, "p-multigrid")

    @cached_property
    def problem(self):
        """`fingerprint.scene_parts` of the scene; only the first time, functions of the user are called.

        Local.
        """
        return scene_parts(self.scene)

    def kept(self):
        """What a restart must not change, beside the problem, as JSON can hold it, by name: dict.  Local."""
        return {
            "degree": self.degree,
            "geometry order": self.geometry_order,
            "enforcement": asdict(self.enforcement),
            **{f"error control's {name}": value for name, value in self.control.used().items()},
        }

    def asked(self):
        """All of it as JSON can hold it, by name: dict.  Local."""
        return {
            "scene": self.scene.name,
            **self.problem,
            "tolerance": self.tolerance,
            "allowed doubts": [*self.allow],
            **self.kept(),
            "goals": [repr(goal) for goal in self.goals],
            **{f"solver's {name}": value for name, value in vars(self.solver).items() if name != "options"},
            **{f"solver's option {name}": value for name, value in self.solver.options.items()},
        }
