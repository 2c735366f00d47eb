"""Checks of what users give: numbers, names, paths; each raises a typed error that says what, and what was given.

All are local: what is checked is the same on all ranks, or the caller raises together.
"""

import os
from difflib import get_close_matches
from numbers import Integral, Real
from pathlib import Path

import numpy as np
from mpi4py import MPI

from fx_contact.parallel.errors import SceneError


def check_number(what, value, positive=False):
    """The value as a float.  Raises SceneError unless it is a finite number, and positive if asked for."""
    is_number = isinstance(value, Real) and not isinstance(value, (bool, np.bool_))
    try:
        number = float(value) if is_number else np.nan
    except OverflowError:
        number = np.inf
    if not np.isfinite(number) or (positive and number <= 0):
        raise SceneError(f"{what} must be a {'positive' if positive else 'finite'} number, got {shown(value)}")
    return number


def check_count(what, value, least=1):
    """Raises SceneError unless a value is a whole number, not smaller than the least, that PETSc can hold."""
    if not isinstance(value, Integral) or isinstance(value, bool) or not least <= value < 2**31:
        raise SceneError(f"{what} must be a whole number, at least {least} and below 2^31, got {shown(value)}")


def check_vector(what, value):
    """Raises SceneError unless a value is three finite numbers."""
    if np.array(value, dtype=object).shape != (3,):
        raise SceneError(f"{what} must have three components, got {shown(value)}")
    for component in value:
        check_number(what, component)


def check_direction(what, value):
    """The unit vector (3,) float64 of a direction.  Raises SceneError unless it is three finite numbers, not all 0."""
    check_vector(what, value)
    vector = np.array(value, np.float64)
    if not vector.any():
        raise SceneError(f"{what} is zero")
    vector /= np.abs(vector).max()
    return vector / np.linalg.norm(vector)


def check_name(kind, name, names, there="there are"):
    """Raises SceneError unless a name is one of some; the error lists them, and says which is nearest.

    Args:
        kind: what it is the name of.
        name: as given.
        names: those that exist.
        there: what stands before their list.
    """
    if not isinstance(name, str) or name not in names:
        exist = ", ".join(map(repr, names)) or "none"
        raise SceneError(f"unknown {kind} {shown(name)}; {there} {exist}{nearest(name, names)}")


def nearest(name, names):
    """The question whether the nearest of some names was meant; empty if none is near."""
    near = get_close_matches(name, names, 1) if isinstance(name, str) else []
    return f"; did you mean {near[0]!r}?" if near else ""


def check_label(what, value):
    """Raises SceneError unless a value is a text that is not empty."""
    if not isinstance(value, str) or not value:
        raise SceneError(f"{what} must be a name, got {shown(value)}")


def check_comm(comm):
    """Raises SceneError unless a value is a communicator of mpi4py that can be used."""
    if not isinstance(comm, MPI.Intracomm) or comm == MPI.COMM_NULL:
        raise SceneError(f"comm must be a communicator of mpi4py, as MPI.COMM_WORLD, got {shown(comm)}")


def check_same_comm(what, theirs, comm):
    """Raises SceneError unless two communicators have the same ranks in the same order."""
    if MPI.Comm.Compare(theirs, comm) not in (MPI.IDENT, MPI.CONGRUENT):
        raise SceneError(f"{what} is on a communicator of {theirs.size} ranks, the run on another one of {comm.size}")


def as_path(what, value, error=SceneError):
    """A path from what the user gave.

    Raises:
        SceneError, or the error given: it is none.
    """
    if not isinstance(value, (str, os.PathLike)) or not str(value):
        raise error(f"{what} must be a path, got {shown(value)}")
    return Path(value)


#: How files are called whose names are given for those of folders.
_FILES = (".bp", ".csv", ".h5", ".json", ".jsonl", ".npz", ".png", ".pvd", ".pvtu", ".vtk", ".vtu", ".xdmf")


def as_folder(what, value, error=SceneError):
    """The path of a folder from what the user gave, which may not be there yet.

    Raises:
        SceneError, or the error given: it is no path, a file, or called like one.
    """
    path = as_path(what, value, error)
    if path.suffix.lower() in _FILES or path.is_file():
        raise error(
            f"{what} must be a folder, got {str(path)!r}: several files will be in it, under names of their own"
        )
    return path


def percent(value):
    """A part as it stands in a sentence, with two digits however small it is: "1.5%"."""
    return f"{100 * value:.2g}%" if abs(value) < 0.1 else f"{value:.0%}"


def shown(value):
    """A value as it stands in an error: not longer than a line."""
    try:
        text = " ".join(repr(value).split())
    except Exception:  # Python writes no whole numbers of thousands of digits; objects of users may fail in any way
        text = object.__repr__(value)
    return text if len(text) <= 200 else f"{text[:190]}... ({type(value).__name__})"
