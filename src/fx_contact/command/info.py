"""Versions of the libraries, and optional packages that are missing.  All is local."""

import os
import platform
import shutil
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec

from mpi4py import MPI

from fx_contact.parallel.versions import library_versions, project_version

#: Optional packages, and what needs them.
_OPTIONAL = {
    "gmsh": "meshes of Gmsh and CAD files",
    "matplotlib": "curves and maps",
    "pyvista": "pictures of bodies, files of fields",
}
#: What a library that PETSc lacks costs.
_WITHOUT = {"hypre": "missing: degree 1 takes PETSc's GAMG, up to 1.1 times the CPU seconds"}


def library_lines() -> Iterator[str]:
    """A line for each library and optional package, with its version or what it is needed for."""
    known: dict[str, str | None] = {"fx_contact": project_version(), "Python": platform.python_version()}
    known |= library_versions() | {"MPI": MPI.Get_library_version().splitlines()[0].split(",")[0]}
    yield from (f"{name:12}{number or _WITHOUT.get(name, 'not there')}" for name, number in known.items())
    for name, use in _OPTIONAL.items():
        yield f"{name:12}" + (_version(name) if find_spec(name) else f"missing: needed for {use}")
    yield f"{'C compiler':12}{_compiler() or 'missing: every solve needs it; install gcc, or set CC'}"
    if not os.environ.get("DISPLAY") and not shutil.which("Xvfb"):
        yield f"{'display':12}missing: pyvista may need one for pictures; install xvfb"


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "installed"


def _compiler() -> str | None:
    """Path of the compiler that FFCx calls."""
    return shutil.which((os.environ.get("CC") or "cc").split()[0]) or shutil.which("gcc")
