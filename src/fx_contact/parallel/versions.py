"""Versions of the libraries that results depend on."""

import ctypes

import dolfinx
import numpy as np
from petsc4py import PETSc


def library_versions():
    """Versions of the libraries that the numbers depend on: dict of str.  Local."""
    return {
        "dolfinx": dolfinx.__version__,
        "petsc": ".".join(map(str, PETSc.Sys.getVersion())),
        "hypre": _hypre_version(),
        "numpy": np.__version__,
    }


def _hypre_version():
    """Release of the hypre that PETSc has loaded, asked from the library itself; None where it does not tell."""
    ask = getattr(ctypes.CDLL(PETSc.__file__), "HYPRE_VersionNumber", None)
    numbers = [ctypes.c_int() for _ in range(4)]
    if ask is None or ask(*map(ctypes.byref, numbers)):
        return None
    return ".".join(str(number.value) for number in numbers[:3])
