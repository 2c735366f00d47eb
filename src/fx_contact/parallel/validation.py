"""Checks of user input: numbers, names, paths; each raises a typed error that shows the value.

All are local: the value is the same on all ranks, or the caller raises on all of them.
"""

import os
from collections.abc import Collection, Sequence
from difflib import get_close_matches
from numbers import Integral, Real
from pathlib import Path
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

from fx_contact.parallel.arrays import FloatArray
from fx_contact.parallel.errors import FxContactError, SceneError

#: Smallest tolerance and error: below it rounding is most of the error.
LEAST_TOLERANCE = 1e-9
#: Difference of an angle from whole degrees that is rounding [degrees].
_SAME_ANGLE = 1e-9


def check_number(what: str, value: object, positive: bool = False) -> float:
    """The value as a float.  Raises SceneError unless it is a finite number, and positive if so required."""
    try:
        number = float(value) if isinstance(value, Real) and not isinstance(value, (bool, np.bool_)) else np.nan
    except OverflowError:
        number = np.inf
    if not np.isfinite(number) or (positive and number <= 0):
        raise SceneError(f"{what} must be a {'positive' if positive else 'finite'} number, got {shown(value)}")
    return number


def check_flag(what: str, value: object) -> bool:
    """The value.  Raises SceneError unless it is True or False."""
    if not isinstance(value, (bool, np.bool_)):
        raise SceneError(f"{what} must be True or False, got {shown(value)}")
    return bool(value)


def check_degrees(what: str, value: object) -> float:
    """An angle [degrees].  Raises SceneError for whole degrees in radians, and for what is no finite number."""
    angle = check_number(what, value)
    degrees = np.degrees(angle)
    if round(degrees) and abs(angle) <= 2 * np.pi and abs(degrees - round(degrees)) < _SAME_ANGLE:
        raise SceneError(f"{what} is in degrees, got {angle:.10g}, which is {degrees:.0f} degrees in radians")
    return angle


def check_tolerance(what: str, value: object) -> float:
    """A prescribed relative error.  Raises SceneError unless it is a number from `LEAST_TOLERANCE` to below 1."""
    tolerance = check_number(what, value, positive=True)
    if tolerance < LEAST_TOLERANCE:
        raise SceneError(
            f"{what} must be at least {LEAST_TOLERANCE:g}, got {tolerance:g}: below that rounding is most of the "
            "error, so that no mesh reaches it"
        )
    if tolerance >= 1:
        raise SceneError(f"{what} is relative and must be below 1, got {tolerance}: 4 % are 0.04")
    return tolerance


def check_count(what: str, value: object, least: int = 1) -> None:
    """Raises SceneError unless a value is a whole number of at least `least` that a 32-bit integer can represent."""
    if not isinstance(value, Integral) or isinstance(value, bool) or not least <= int(value) < 2**31:
        raise SceneError(f"{what} must be a whole number, at least {least} and below 2^31, got {shown(value)}")


def is_function(what: str, value: object) -> bool:
    """True for a function of position.  Raises SceneError for an object of UFL or dolfinx, which can be called too."""
    if isinstance(value, ufl.core.expr.Expr):
        raise SceneError(
            f"{what} must be a number or a function of position, x of shape (3, n), as `Function.interpolate` takes; "
            f"got {type(value).__name__} of {type(value).__module__.split('.')[0]}"
        )
    return callable(value)


def check_vector(what: str, value: Any) -> tuple[float, float, float]:
    """The value as three floats.  Raises SceneError unless it is three finite numbers."""
    if np.array(value, dtype=object).shape != (3,):
        raise SceneError(f"{what} must have three components, got {shown(value)}")
    x, y, z = (check_number(what, component) for component in value)
    return x, y, z


def check_direction(what: str, value: Any) -> FloatArray:
    """Unit vector (3,) of a direction.  Raises SceneError unless it is three finite numbers, not all of them 0."""
    vector = np.array(check_vector(what, value))
    if not vector.any():
        raise SceneError(f"{what} is zero")
    vector /= np.abs(vector).max()
    return vector / np.linalg.norm(vector)


def check_name(kind: str, name: object, names: Collection[str], there: str = "there are") -> None:
    """Raises SceneError unless a name is one of the existing ones of its kind, listed after the words `there`."""
    if not isinstance(name, str) or name not in names:
        exist = ", ".join(map(repr, names)) or "none"
        raise SceneError(f"unknown {kind} {shown(name)}; {there} {exist}{nearest(name, names)}")


def nearest(name: object, names: Collection[str]) -> str:
    """Question whether the only name that begins so, or the most similar one, was meant; empty if there is none."""
    if not isinstance(name, str):
        return ""
    longer = [one for one in names if name and one.startswith(name)]
    near = longer if len(longer) == 1 else get_close_matches(name, names, 1)
    return f"; did you mean {near[0]!r}?" if near else ""


def check_label(what: str, value: object) -> None:
    """Raises SceneError unless a value is a non-empty string."""
    if not isinstance(value, str) or not value:
        raise SceneError(f"{what} must be a name, got {shown(value)}")


def check_kind(what: str, value: object, *kinds: type) -> None:
    """Raises SceneError unless a value is an object of one of some classes."""
    if not isinstance(value, kinds):
        raise SceneError(f"{what} must be a {' or '.join(kind.__name__ for kind in kinds)}, got {shown(value)}")


def as_tuple(what: str, value: object, *kinds: type) -> tuple[Any, ...]:
    """Objects of some classes as a tuple, of a tuple or list or of one object.  Raises SceneError for others."""
    items = (value,) if isinstance(value, kinds) else value
    if not isinstance(items, (tuple, list)) or not all(isinstance(item, kinds) for item in items):
        wanted = " and ".join(kind.__name__ for kind in kinds)
        raise SceneError(f"{what} must be a tuple of {wanted}, got {shown(value)}")
    return tuple(items)


def check_kinds(what: str, values: object, *kinds: type) -> None:
    """Raises SceneError unless a value is a list of objects of some classes."""
    if not isinstance(values, Sequence) or not all(isinstance(value, kinds) for value in values):
        wanted = " or ".join(kind.__name__ for kind in kinds)
        raise SceneError(f"{what} must be a list, each a {wanted}, got {shown(values)}")


def check_comm(comm: object) -> None:
    """Raises SceneError unless a value is a valid intracommunicator of mpi4py."""
    if not isinstance(comm, MPI.Intracomm) or comm == MPI.COMM_NULL:
        raise SceneError(f"comm must be a communicator of mpi4py, as MPI.COMM_WORLD, got {shown(comm)}")


def check_same_comm(what: str, theirs: MPI.Comm, comm: MPI.Comm) -> None:
    """Raises SceneError unless two communicators have the same ranks in the same order."""
    if MPI.Comm.Compare(theirs, comm) not in (MPI.IDENT, MPI.CONGRUENT):
        raise SceneError(f"{what} is on a communicator of {theirs.size} ranks, the run on another one of {comm.size}")


def as_path(what: str, value: object, error: type[FxContactError] = SceneError) -> Path:
    """The value as a path.  Raises SceneError, or the error given, if it is none."""
    if not isinstance(value, (str, os.PathLike)) or not str(value):
        raise error(f"{what} must be a path, got {shown(value)}")
    return Path(value)


#: Suffixes of files that are mistaken for folders.
_FILES = (".bp", ".csv", ".h5", ".json", ".jsonl", ".npz", ".png", ".pvd", ".pvtu", ".vtk", ".vtu", ".xdmf")


def as_folder(what: str, value: object, error: type[FxContactError] = SceneError) -> Path:
    """The path of a folder, which need not exist.

    Raises SceneError, or the error given, for an existing file, a name like one, or no path.
    """
    path = as_path(what, value, error)
    if path.suffix.lower() in _FILES or path.is_file():
        raise error(
            f"{what} must be a folder, got {str(path)!r}: several files will be in it, under names of their own"
        )
    return path


def percent(value: float) -> str:
    """A fraction as a percentage, with two digits if it is small: "1.5%"."""
    return f"{100 * value:.2g}%" if abs(value) < 0.1 else f"{value:.0%}"


def shown(value: object) -> str:
    """Representation of a value for an error message, shortened to a line."""
    try:
        text = " ".join(repr(value).split())
    except Exception:  # Python refuses integers of thousands of digits; objects of users may fail in any way
        text = object.__repr__(value)
    return text if len(text) <= 200 else f"{text[:190]}... ({type(value).__name__})"
