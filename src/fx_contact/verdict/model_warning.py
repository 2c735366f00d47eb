"""Model warnings: violated assumptions of the model, however small the error; entry `doubts` of a record.

Those of a scene are in `scene_warnings`, those of a solution in `solution_warnings`, `penetration` and `kinks`; here a
largest pressure that grows: at a sharp edge it is infinite, and larger on each finer mesh.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from fx_contact.parallel.errors import ValidityError
from fx_contact.parallel.validation import as_tuple, check_name

Point: TypeAlias = tuple[float, float, float]

#: Limit of strain and rotation: 2.5 % of it, or of the stress, is omitted.
LARGE = 0.05
#: Kinds of warnings that are errors from these values on, unless they are allowed: 25 % is omitted.
REFUSED = {"large strain": 0.5, "large rotation": 0.5, "no load": 0.0}
#: Limit of the part of a load that the mesh misses [-].
MISSED = 0.01
#: Refinements after each of which the largest pressure has grown by more than `GROWTH`.  Under a stamp with sharp edges
#: it grows by 17 % or more on most meshes, at a corner of a cube by 61 % with each level; of round contact by less than
#: 1 % from 28 closed pairs on (studies.goals.pressures), below a rounded edge once by 19 % (studies/goals).
GROWTHS = 3
GROWTH = 0.05
#: Closed pairs from which on a mesh resolves round contact, in the modelled part.
RESOLVED = 28


@dataclass(frozen=True)
class ModelWarning:
    """A violated modelling assumption.

    Attributes:
        kind: "large strain", "large rotation", "sliding", "load step", "no contact", "initial overlap",
            "unresolved load", "growing pressure", "kinks", "uncovered", "oblique direction", "penetration", "no load",
            "unbalanced moment", "zero load", "held load", "load on contact" or "free on a plane".
        value: found, in the unit that the message says.
        limit: exceeded by the value; for "no contact" and "no load" reached.
        place: a point, undeformed [m], or the name of a body, a surface or the scene.
        message: a sentence with all of it.
    """

    kind: str
    value: float
    limit: float
    place: Point | str
    message: str

    def __str__(self) -> str:
        return f"{self.kind}: {self.message}"


def checked_kinds(allow: str | Sequence[str]) -> tuple[str, ...]:
    """Kinds of warnings to allow, or one, as a tuple.  Local.  Raises SceneError unless they are keys of `REFUSED`."""
    kinds = as_tuple("allow, the kinds of warnings,", allow, str)
    for kind in kinds:
        check_name("kind of warnings to allow", kind, REFUSED)
    return kinds


def check_model_warnings(warnings: Sequence[ModelWarning], allow: Sequence[str]) -> None:
    """Raises ValidityError if a warning is an error by `REFUSED`, and its kind is not allowed.  Local."""
    for warning in warnings:
        if warning.kind not in allow and warning.value >= REFUSED.get(warning.kind, np.inf):
            kind = repr(warning.kind)
            raise ValidityError(
                f"{warning.message}; allow=({kind},), or --allow {kind} of a demo, goes on all the same"
            )


def growing_pressure(scene: str, pressures: Sequence[float], closed: Sequence[int]) -> list[ModelWarning]:
    """A largest pressure of all contacts that has grown on each of the last meshes.  Local.

    Args:
        scene: its name.
        pressures: largest one of each step so far [Pa].
        closed: number of closed pairs of each step.
    """
    values = pressures[-GROWTHS - 1 :]
    if len(values) <= GROWTHS or not all(values):
        return []
    growth = min(new / old - 1 for old, new in zip(values, values[1:]))
    if growth <= GROWTH:
        return []
    cause = "at a sharp edge it is infinite"
    if closed[-2] < RESOLVED:
        cause = f"{closed[-2]} closed node pairs on the mesh before do not resolve it ({RESOLVED} do round contact)"
    message = (
        f"the largest contact pressure has grown by {growth:.0%} or more on each of the last {GROWTHS} meshes, from "
        f"{values[0]:.4g} to {values[-1]:.4g}: {cause}; limit {GROWTH:.0%}"
    )
    return [ModelWarning("growing pressure", growth, GROWTH, scene, message)]
