"""Versions of the libraries that results depend on."""

import ctypes
from pathlib import Path

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
    """Release of the hypre that PETSc has loaded, asked from the library itself; None where it cannot be found."""
    maps = Path("/proc/self/maps")
    loaded = (
        {line.split()[-1] for line in maps.read_text().splitlines() if "libHYPRE" in line} if maps.exists() else ()
    )
    for path in sorted(loaded):
        ask = getattr(ctypes.CDLL(path), "HYPRE_VersionNumber", None)
        numbers = [ctypes.c_int() for _ in range(4)]
        if ask is not None and ask(*map(ctypes.byref, numbers)) == 0:
            return ".".join(str(n.value) for n in numbers[:3])
    return None
