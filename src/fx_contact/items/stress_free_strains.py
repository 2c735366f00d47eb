"""Stress-free strains: the strain eps_0 that a free part has without stress, sigma = C (eps(u) - eps_0).

Values are numbers, checked when a strain is made, or functions of positions (3, n), checked when evaluated.  All is
local.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from fx_contact.items.boundary_conditions import Placed, ScalarValue, TensorValue, check_value, evaluated
from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_label, check_number, is_function, shown

#: Largest asymmetry of a tensor relative to its largest component: rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class ThermalStrain(Placed):
    """Isotropic thermal strain eps_0 = alpha dT I of a body with all its parts, or of a part.

    Raises SceneError if the part has no name, the expansion is no finite number, or the change neither that nor a
    function.

    Attributes:
        expansion: coefficient alpha of linear thermal expansion [1/K].
        change: dT, temperature less that of the stress-free state [K], constant or a function of the position.
    """

    KIND = "the change of temperature of"

    part: str
    expansion: float
    change: ScalarValue

    def __post_init__(self) -> None:
        check_label("the part of a thermal strain", self.part)
        object.__setattr__(self, "expansion", check_number(f"the expansion of {self.part!r}", self.expansion))
        check_value(self.what, self.change, 1)

    @property
    def value(self) -> ScalarValue:
        """A number that is 0 without strain, or a function."""
        return self.change if callable(self.change) else self.expansion * self.change

    def at(self, points: FloatArray) -> FloatArray:
        """eps_0 (n, 3, 3) [-] at points (n, 3) [m]; errors of `evaluated`."""
        change = evaluated(self.what, self.change, points)
        return np.asarray(self.expansion * change[:, None, None] * np.eye(3))


@dataclass(frozen=True)
class InitialStrain(Placed):
    """A symmetric stress-free strain eps_0 of a body with all its parts, or of a part: swelling, shrinkage, misfit.

    Raises SceneError if the part has no name, or the value is neither a symmetric tensor nor a function.

    Attributes:
        value: tensor (3, 3) in x, y, z [-], constant or a function of the position.
    """

    KIND = "the initial strain of"

    part: str
    value: TensorValue

    def __post_init__(self) -> None:
        check_label("the part of an initial strain", self.part)
        if not is_function(self.what, self.value):
            tensor = _symmetric(self.what, np.array([self.value], dtype=object), self.value)
            object.__setattr__(self, "value", tuple(map(tuple, tensor[0].tolist())))

    def at(self, points: FloatArray) -> FloatArray:
        """eps_0 (n, 3, 3) [-] at points (n, 3) [m].

        Raises SceneError, as `evaluated`, for values of another shape, not finite or not symmetric.
        """
        return _symmetric(self.what, evaluated(self.what, self.value, points, 3, 3), self.value)


def _symmetric(what: str, tensors: npt.NDArray[Any], given: object) -> FloatArray:
    """Tensors (n, 3, 3).  Raises SceneError unless they are finite and symmetric."""
    try:
        result = np.asarray(tensors, dtype=np.float64)
    except (TypeError, ValueError):
        result = np.empty(0)
    if result.shape[1:] != (3, 3) or not np.isfinite(result).all():
        raise SceneError(f"{what} must be a tensor of 3 x 3 finite numbers or a function, got {shown(given)}")
    off = np.abs(result - result.transpose(0, 2, 1)).max(initial=0.0)
    if off > _ROUNDING * np.abs(result).max(initial=0.0):
        raise SceneError(
            f"{what} must be symmetric, its components differ by {off:.3g}: take tensor shears, half the angles"
        )
    return result
