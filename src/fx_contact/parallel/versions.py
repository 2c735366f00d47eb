"""Versions of the libraries on which results depend."""

import ctypes
import sys

import numpy as np
from dolfinx.cpp import __version__ as dolfinx_version
from petsc4py import PETSc


def library_versions() -> dict[str, str | None]:
    """Name -> version of the numerical libraries; None if a library does not report it.  Local."""
    return {
        "dolfinx": dolfinx_version,
        "petsc": ".".join(map(str, PETSc.Sys.getVersion())),
        "hypre": _hypre_version(),
        "numpy": np.__version__,
    }


def project_version() -> str:
    """Version of this package.  Local."""
    return str(sys.modules["fx_contact"].__version__)


def _hypre_version() -> str | None:
    ask = getattr(ctypes.CDLL(PETSc.__file__), "HYPRE_VersionNumber", None)
    numbers = [ctypes.c_int() for _ in range(4)]
    if ask is None or ask(*map(ctypes.byref, numbers)):
        return None
    return ".".join(str(number.value) for number in numbers[:3])
